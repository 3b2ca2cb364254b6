from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, get_args

import pytest
from helpers_folders import with_provenance

from lfobench.errors import UserError
from lfobench.record import Evaluation, Failure, Record
from lfobench.score import parse_statistic
from lfobench.stats.highlight import Rule
from lfobench.stats.options import Test
from lfobench.stats.tests import PAIRED
from lfobench.tables.building import build_table
from lfobench.tables.exporters import FORMATS, export
from lfobench.tables.table import Cell, Table, cell_text, column_groups


def crash(record: Record) -> Failure:
    """The record's run, crashed."""
    return Failure(
        identity_hash=record.identity_hash, identity=record.identity, labels=record.labels, error="gone", traceback=[]
    )


def cell(table: Table, row: str, column: str) -> Cell | None:
    return next(
        found
        for table_row, table_column, found in table.cells()
        if (table_row.label, table_column.label) == (row, column)
    )


def test_rows_stand_in_blocks_and_columns_in_groups(example: list[Record]) -> None:
    table = build_table(example)
    assert [(block.label, [row.label for row in block.rows]) for block in table.blocks] == [
        ("random+expert", ["hopper", "halfcheetah"]),
        ("random+few-expert", ["hopper", "halfcheetah"]),
    ]
    groups = {
        group.label: [column.label for column in table.columns[group.start : group.stop]]
        for group in column_groups(table.columns)
    }
    assert groups == {
        "Access to expert actions": ["bc-expert", "bc"],
        "No expert actions": ["oril", "smodice", "dilo"],
    }


def test_order_follows_the_names_passed_in(example: list[Record]) -> None:
    shuffled = random.Random(0).sample(example, len(example))
    tasks = [f"{row}-{group}" for group in ("random-few-expert", "random-expert") for row in ("halfcheetah", "hopper")]
    table = build_table(shuffled, tasks=tasks, methods=["dilo", "bc", "oril", "smodice", "bc-expert"])
    assert [row.task for _, row in table.rows()] == tasks
    assert [column.label for column in table.columns] == ["bc", "bc-expert", "dilo", "oril", "smodice"]


def test_the_order_of_records_changes_no_cell(example: list[Record]) -> None:
    order = {"tasks": [record.task for record in example], "methods": [record.method for record in example]}
    shuffled = random.Random(1).sample(example, len(example))
    assert build_table(shuffled, **order).blocks == build_table(example, **order).blocks


def test_cells_summarize_seeds(make_cell: Callable[..., list[Record]]) -> None:
    found = cell(build_table(make_cell([90.0, 100.0, 110.0])), "hopper", "dilo")
    assert found is not None
    assert (found.summary.n, found.summary.mean, found.summary.std) == (3, 100.0, 10.0)
    assert found.seeds == (0, 1, 2)


def test_a_diverged_seed_scores_zero_and_is_counted(
    make_cell: Callable[..., list[Record]], make_record: Callable[..., Record]
) -> None:
    records = [*make_cell([100.0, 100.0]), make_record(100.0, seed=2, diverged_at=500)]
    found = cell(build_table(records), "hopper", "dilo")
    assert found is not None
    assert found.summary.mean == pytest.approx(200 / 3)
    assert found.diverged_seeds == (2,)


def test_the_statistic_chooses_the_number(make_record: Callable[..., Record]) -> None:
    record = make_record(0.0).model_copy(
        update={
            "evaluations": [
                Evaluation(step=step, returns=[10.0 * score], lengths=[10])
                for step, score in enumerate([99.0, 10.0, 20.0, 30.0, 40.0, 50.0])
            ]
        }
    )
    means = {}
    for statistic in ("last5", "last", "best", "at:1"):
        found = cell(build_table([record], parse_statistic(statistic)), "hopper", "dilo")
        assert found is not None and found.summary is not None
        means[statistic] = found.summary.mean
    assert means == {
        "last5": pytest.approx(30.0),
        "last": pytest.approx(50.0),
        "best": pytest.approx(99.0),
        "at:1": pytest.approx(10.0),
    }


def test_highlights_only_among_methods_without_expert_actions(make_cell: Callable[..., list[Record]]) -> None:
    table = build_table(
        make_cell([120.0, 121.0, 122.0], "bc", sees_expert_actions=True)
        + make_cell([90.0, 91.0, 92.0], "dilo")
        + make_cell([20.0, 21.0, 22.0], "oril")
    )
    highlighted = {column.label for _, column, found in table.cells() if found and found.highlighted}
    assert highlighted == {"dilo"}
    assert next(row for _, row in table.rows()).outcome == "better"


def test_alpha_is_the_level_of_the_test(make_cell: Callable[..., list[Record]]) -> None:
    records = make_cell([90.0, 95.0, 100.0], "dilo") + make_cell([70.0, 80.0, 84.0], "oril")
    p = next(row.p for _, row in build_table(records).rows())
    assert p is not None
    for alpha, expected in ((p * 1.01, {"dilo"}), (p * 0.99, {"dilo", "oril"})):
        table = build_table(records, rule=Rule(alpha=alpha))
        assert {column.label for _, column, found in table.cells() if found and found.highlighted} == expected


def test_a_single_seed_has_a_table_without_spread(make_record: Callable[..., Record]) -> None:
    table = build_table([make_record(90.0, "dilo"), make_record(20.0, "oril")])
    found = cell(table, "hopper", "dilo")
    assert found is not None and found.summary.std is None
    assert next(row for _, row in table.rows()).outcome == "untested"


def test_a_missing_cell_is_none(example: list[Record]) -> None:
    missing = [(row.task, column.label) for row, column, found in build_table(example).cells() if found is None]
    assert missing == [("halfcheetah-random-few-expert", "oril")]


def test_two_tasks_with_one_short_name_go_by_their_full_names(make_record: Callable[..., Record]) -> None:
    table = build_table([make_record(1.0, task="hopper-a"), make_record(1.0, task="hopper-b")])
    assert [row.label for _, row in table.rows()] == ["hopper-a", "hopper-b"]


def test_no_records_is_an_error_with_a_way_out() -> None:
    with pytest.raises(UserError, match="no records"):
        build_table([])


def test_the_demonstration_is_a_column_of_its_own_that_nobody_competes_with(
    make_cell: Callable[..., list[Record]],
) -> None:
    records = make_cell([90.0, 91.0, 92.0]) + make_cell([5.0, 6.0, 7.0], "oril") + make_cell([5.0, 6.0], row="ant")
    known = [with_provenance(record, demonstration_score=103.5) for record in records if "hopper" in record.task]
    records = known + [record for record in records if "hopper" not in record.task]
    for scope in ("group", "all"):
        table = build_table(records, rule=Rule(scope=scope))  # type: ignore[arg-type]
        assert [group.label for group in column_groups(table.columns)] == ["No expert actions", "Expert"]
        found = cell(table, "hopper", "demonstration")
        assert found is not None and found.summary is not None
        assert (found.summary.n, found.summary.mean, found.summary.std) == (1, 103.5, None)
        assert not found.highlighted
        assert cell(table, "ant", "demonstration") is None
        dilo = cell(table, "hopper", "dilo")
        assert dilo is not None and dilo.highlighted


@pytest.mark.parametrize("score", [None, "103", float("nan"), float("inf"), [1.0], {}])
def test_a_demonstration_without_a_number_has_no_column(score: object, make_record: Callable[..., Record]) -> None:
    table = build_table([with_provenance(make_record(1.0), demonstration_score=score)])
    assert [column.kind for column in table.columns] == ["observations"]


# --- failed seeds ----------------------------------------------------------------------------------------------------


def test_failed_seeds_are_counted_beside_the_scores(make_cell: Callable[..., list[Record]]) -> None:
    failures = [crash(record) for record in make_cell([0.0] * 5)[3:]]
    table = build_table(
        make_cell([90.0, 91.0, 92.0]) + make_cell([1.0, 2.0], "oril"), failures=[*failures, failures[0]]
    )
    found = cell(table, "hopper", "dilo")
    assert found is not None and found.summary is not None
    assert (found.seeds, found.failed_seeds, found.summary.n) == ((0, 1, 2), (3, 4), 3)
    assert found.highlighted
    other = cell(table, "hopper", "oril")
    assert other is not None and other.failed_seeds == ()


def test_a_cell_whose_every_seed_failed_has_no_number_and_does_not_compete(
    make_cell: Callable[..., list[Record]],
) -> None:
    records = make_cell([90.0, 91.0]) + make_cell([1.0, 2.0], "oril") + make_cell([5.0, 6.0], "oril", row="ant")
    failures = [crash(record) for record in make_cell([0.0, 0.0], row="ant")]
    table = build_table(records, failures=failures)
    assert cell(table, "ant", "dilo") == Cell(sample=None, failed_seeds=(0, 1))
    ant = next(row for _, row in table.rows() if row.label == "ant")
    assert (ant.outcome, ant.p) == ("unopposed", None)


OTHER_PROTOCOL = {
    "name": "paper",
    "steps": 20_000,
    "steps_assigned": False,
    "evaluation_every": 1000,
    "evaluation_episodes": 10,
}


@pytest.mark.parametrize(
    "identity",
    [
        {"preset": "paper"},
        {"method_version": 2},
        {"set": {"tau": 3}, "config": {"batch_size": 256, "tau": 3}},
        {"config": {"batch_size": 512, "tau": 0.06}},
        {"method": "oril", "source": "d4rl"},
        {"task": "ant-random-expert", "protocol": OTHER_PROTOCOL},
        {"source": "d4rl"},
        {"protocol": OTHER_PROTOCOL},
        {"protocol": OTHER_PROTOCOL | {"name": "quick", "steps": 5}},
        {"simulator": {"gymnasium": "1.4.0", "mujoco": "3.4.0"}},
        {"data": {"offline": "a1", "expert": "c3"}},
        {"precision": "bf16"},
    ],
    ids=str,
)
def test_a_failure_of_another_variant_or_under_other_conditions_is_not_counted(
    identity: dict[str, Any], make_cell: Callable[..., list[Record]], make_record: Callable[..., Record]
) -> None:
    table = build_table(make_cell([90.0, 91.0]), failures=[crash(make_record(0.0, seed=7, **identity))])
    assert all(found is None or found.failed_seeds == () for _, _, found in table.cells())
    assert len(table.columns) == 1


def test_failures_find_the_column_of_their_variant(
    make_cell: Callable[..., list[Record]], make_record: Callable[..., Record]
) -> None:
    changed = {"set": {"tau": 3}, "config": {"batch_size": 256, "tau": 3}}
    failures = [crash(make_record(0.0, seed=7)), crash(make_record(0.0, seed=8, **changed))]
    table = build_table(make_cell([90.0, 91.0]) + make_cell([90.0, 91.0], **changed), failures=failures)
    failed = {column.label: found.failed_seeds for _, column, found in table.cells() if found}
    assert failed == {"dilo": (7,), "dilo(tau=3)": (8,)}


def test_a_failure_counts_where_a_config_follows_the_task(
    make_cell: Callable[..., list[Record]], make_record: Callable[..., Record]
) -> None:
    """The column's other rows were run with another config, as its preset asks."""
    records = make_cell([1.0, 2.0], config={"tau": 0.06}) + make_cell([1.0, 2.0], "oril", row="ant")
    table = build_table(records, failures=[crash(make_record(0.0, row="ant", config={"tau": 3.0}))])
    assert cell(table, "ant", "dilo") == Cell(sample=None, failed_seeds=(0,))


def test_a_task_and_a_method_of_which_every_run_crashed_have_their_row_and_column(
    make_cell: Callable[..., list[Record]], make_record: Callable[..., Record]
) -> None:
    crashes = [
        crash(make_record(0.0, row="ant")),
        *(crash(make_record(0.0, "mine", seed)) for seed in (0, 1)),
        crash(make_record(0.0, "cloned", 3, sees_expert_actions=True)),
    ]
    table = build_table(make_cell([90.0, 91.0]), methods=["mine", "dilo"], failures=crashes)
    assert [column.label for column in table.columns] == ["cloned", "mine", "dilo"]
    assert [column.kind for column in table.columns] == ["actions", "observations", "observations"]
    found = {(row.label, column.label): cell_text(each) for row, column, each in table.cells() if each}
    assert {place: text.mean for place, text in found.items()} == {
        ("hopper", "cloned"): "crashed",
        ("hopper", "mine"): "crashed",
        ("hopper", "dilo"): "90.5",
        ("ant", "dilo"): "crashed",
    }
    assert found["hopper", "mine"].failed == "2"
    note = next(note.text for note in table.notes if note.label == "Failed")
    assert "mine on hopper-random-expert, seeds 0, 1" in note and "dilo on ant-random-expert, seed 0" in note
    for name in FORMATS:
        assert name == "json" or name == "csv" or export(table, name).count("crashed") >= 4


def test_where_every_run_crashed_the_first_crash_is_named(make_record: Callable[..., Record]) -> None:
    with pytest.raises(UserError) as caught:
        build_table([], failures=[crash(make_record(0.0, "mine", seed)) for seed in (4, 5)])
    assert "2 runs crashed" in caught.value.problem and "mine on hopper-random-expert, seed 4" in caught.value.problem


def test_a_seed_that_has_a_score_did_not_fail(
    make_cell: Callable[..., list[Record]], make_record: Callable[..., Record]
) -> None:
    table = build_table(make_cell([90.0, 91.0]), failures=[crash(make_record(0.0, seed=1))])
    found = cell(table, "hopper", "dilo")
    assert found is not None and found.failed_seeds == ()


# --- the rule --------------------------------------------------------------------------------------------------------


def test_scope_all_lets_every_method_compete(make_cell: Callable[..., list[Record]]) -> None:
    records = (
        make_cell([120.0, 121.0, 122.0], "bc", sees_expert_actions=True)
        + make_cell([90.0, 91.0, 92.0], "dilo")
        + make_cell([20.0, 21.0, 22.0], "oril")
    )
    table = build_table(records, rule=Rule(scope="all"))
    assert {column.label for _, column, found in table.cells() if found and found.highlighted} == {"bc"}


def with_starts(records: list[Record], *by_seed: list[float]) -> list[Record]:
    """The records with these scores from each start, the same in every evaluation."""
    return [
        record.model_copy(
            update={
                "evaluations": [
                    Evaluation(step=step, returns=[10.0 * score for score in starts], lengths=[1] * len(starts))
                    for step in (1000, 2000)
                ]
            }
        )
        for record, starts in zip(records, by_seed, strict=True)
    ]


def test_starts_are_means_over_seeds(make_cell: Callable[..., list[Record]]) -> None:
    records = with_starts(make_cell([0.0, 0.0]), [10.0, 20.0, 60.0], [30.0, 40.0, 20.0])
    found = cell(build_table(records), "hopper", "dilo")
    assert found is not None and found.sample is not None
    assert found.sample.seeds == pytest.approx((30.0, 30.0))
    assert found.sample.starts == pytest.approx((20.0, 30.0, 40.0))


def test_a_diverged_seed_pulls_every_start_down(make_cell: Callable[..., list[Record]]) -> None:
    first, second = with_starts(make_cell([0.0, 0.0]), [10.0, 30.0], [0.0, 0.0])
    diverged = second.model_copy(update={"status": "diverged", "diverged_at": 5})
    found = cell(build_table([first, diverged]), "hopper", "dilo")
    assert found is not None and found.sample is not None
    assert found.sample.starts == pytest.approx((5.0, 15.0))


def test_seeds_with_other_numbers_of_episodes_have_a_mean_and_no_starts(
    make_cell: Callable[..., list[Record]],
) -> None:
    records = with_starts(make_cell([0.0, 0.0]), [10.0, 20.0, 60.0], [30.0, 50.0])
    found = cell(build_table(records), "hopper", "dilo")
    assert found is not None and found.sample is not None
    assert found.sample.seeds == pytest.approx((30.0, 40.0))
    assert found.sample.starts == ()
    with pytest.raises(
        UserError, match=r"The test cannot be made: 'wilcoxon' needs start states.*--test, e\.g\. welch"
    ):
        build_table(records + make_cell([1.0, 2.0], "oril"), rule=Rule(test="wilcoxon"))


@pytest.mark.parametrize("test", get_args(Test))
def test_every_test_decides_a_row(test: Test, make_cell: Callable[..., list[Record]]) -> None:
    spread = [[90.0 + start + seed for start in range(8)] for seed in range(5)]
    records = with_starts(make_cell([0.0] * 5), *spread) + with_starts(
        make_cell([0.0] * 5, "oril"), *([score / 2 for score in starts] for starts in spread)
    )
    (_, row), *_ = build_table(records, rule=Rule(test=test)).rows()
    assert row.outcome == "better"
    assert row.p is not None
    few = build_table([record for record in records if record.seed == 0], rule=Rule(test=test))
    (_, row), *_ = few.rows()
    assert row.outcome == ("better" if test in PAIRED else "untested")


def test_a_row_of_samples_without_spread(make_cell: Callable[..., list[Record]]) -> None:
    (_, row), *_ = build_table(make_cell([90.0] * 3) + make_cell([80.0] * 3, "oril")).rows()
    assert (row.outcome, row.p) == ("better", 0.0)
    (_, row), *_ = build_table(make_cell([90.0] * 3) + make_cell([90.0] * 3, "oril")).rows()
    assert (row.outcome, row.p) == ("undecided", 1.0)


def test_the_dagger_stands_at_the_best_of_a_row_that_a_correction_loses(make_cell: Callable[..., list[Record]]) -> None:
    records = make_cell([96.0, 100.0, 104.0]) + make_cell([84.0, 90.0, 94.0], "oril")
    for row in ("ant", "walker2d", "halfcheetah"):
        records += make_cell([96.0, 100.0, 104.0], row=row) + make_cell([95.0, 99.0, 104.0], "oril", row=row)
    for correction, highlighted in (("none", {"dilo"}), ("holm", {"dilo", "oril"})):
        table = build_table(records, rule=Rule(correction=correction))  # type: ignore[arg-type]
        hopper = [(column.label, found) for row, column, found in table.cells() if row.label == "hopper" and found]
        assert {label for label, found in hopper if found.highlighted} == highlighted
        assert [label for label, found in hopper if found.lost] == ["dilo"]
        assert not any(found.lost for row, _, found in table.cells() if row.label != "hopper" and found)
