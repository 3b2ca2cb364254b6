from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from lfobench.contract.record import Evaluation, Record
from lfobench.contract.statistic import parse_statistic
from lfobench.errors import UserError
from lfobench.render.building import build_table
from lfobench.render.table import Cell, Table, column_groups
from lfobench.stats.highlight import Rule


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
