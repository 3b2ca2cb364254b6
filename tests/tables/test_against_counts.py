"""Published columns: success counts."""

from __future__ import annotations

import json

import pytest
from helpers_records import endings, make_cell, make_counted

from lfobench.errors import UserError
from lfobench.records.publication import (
    PrintedCount,
    PrintedMean,
    Publication,
    PublishedRow,
    TableOfCounts,
    TableOfMeans,
)
from lfobench.records.published import read_publication
from lfobench.stats.highlight import Rule
from lfobench.stats.successes import fisher_test
from lfobench.tables.building import build_table
from lfobench.tables.exporters import FORMATS, export
from lfobench.tables.published_columns import published_counts, with_publication
from lfobench.tables.table import Table, cell_text, column_groups

FISHER = Rule("fisher")
FIELDS = {
    "task": "safe-manipulation",
    "dataset": "few-trajectories",
}


def publication(place: dict[str, str] | None = None, **counts: tuple[int, int]) -> Publication:
    row = PublishedRow(
        place or FIELDS, {method: PrintedCount(*count, highlighted=None) for method, count in counts.items()}
    )
    return Publication("paper", "", (TableOfCounts("Robot table", (row,)),))


@pytest.fixture
def table() -> Table:
    return build_table(
        [
            *(make_counted(endings(9, 10), endings(90, 100), seed=seed) for seed in range(2)),
            make_counted(endings(1, 10), endings(10, 100), "bco"),
            make_counted(endings(1, 10), endings(10, 100), "new-method"),
            make_counted(endings(3, 10), endings(30, 100), group="fixed-start"),
        ],
        rule=FISHER,
    )


def published_cells(table: Table) -> dict[tuple[str, str], object]:
    return {
        (row.task, column.label): cell and (cell.agreement, cell.agreement_p)
        for row, column, cell in table.cells()
        if not column.run_here
    }


def test_every_verdict_is_fishers_of_the_pooled_counts(table: Table) -> None:
    shown = with_publication(table, publication(dilo=(8, 10), bco=(10, 10)), 5.0, anyway=True)
    found = published_cells(shown)
    task = "safe-manipulation-few-trajectories"
    assert found[task, "dilo"] == ("not told apart", pytest.approx(fisher_test(198, 220, 8, 10)))
    assert found[task, "bco"] == ("differs", pytest.approx(fisher_test(11, 110, 10, 10)))
    assert found["safe-manipulation-fixed-start", "dilo"] is None
    texts = [str(cell_text(cell)) for _, column, cell in shown.cells() if cell and not column.run_here]
    assert texts == [f"8/10 [49, 94] ∼ p {fisher_test(198, 220, 8, 10):.2g}", "10/10 [72, 100] ≠ p <0.001"]


def test_the_level_is_the_rules(table: Table) -> None:
    loose = build_table(
        [make_counted(endings(9, 10)), make_counted(endings(1, 10), method="bco")], rule=Rule("fisher", alpha=0.5)
    )
    p = fisher_test(9, 10, 6, 10)
    assert 0.05 < p < 0.5
    for shown, verdict in (
        (loose, "differs"),
        (build_table([make_counted(endings(9, 10))], rule=FISHER), "not told apart"),
    ):
        (found, *_) = published_cells(with_publication(shown, publication(dilo=(6, 10)), 5.0, anyway=True)).values()
        assert found == (verdict, pytest.approx(p))


def test_a_robot_is_never_shown_as_comparable(table: Table) -> None:
    with pytest.raises(UserError) as refused:
        with_publication(table, publication(dilo=(8, 10)), 5.0, anyway=False)
    assert "simulated (source 'generated', protocol 'quick')" in str(refused.value)
    assert "--anyway" in refused.value.remedy
    shown = with_publication(table, publication(dilo=(8, 10)), 5.0, anyway=True)
    assert column_groups(shown.columns)[-1].label == "Published, not comparable"
    text = {note.label: note.text for note in shown.notes}
    assert text["Published"].startswith("paper, Robot table: successes out of trials as printed")
    assert "no proof that they agree" in text["Published"]
    assert text["Not comparable"].endswith("shown because --anyway was asked for.")


def test_ghosts_change_nothing_of_ours(table: Table) -> None:
    shown = with_publication(table, publication(dilo=(0, 10)), 5.0, anyway=True)
    for (_, before), (_, after) in zip(table.rows(), shown.rows(), strict=True):
        assert after.cells[: len(before.cells)] == before.cells
        assert (after.p, after.outcome) == (before.p, before.outcome)


@pytest.mark.parametrize("format_name", FORMATS)
def test_every_format_shows_the_published_counts(table: Table, format_name: str) -> None:
    text = export(with_publication(table, publication(dilo=(7, 11)), 5.0, anyway=True), format_name)
    if format_name == "json":
        cell = json.loads(text)["rows"][0]["cells"][-1]
        assert cell["successes"]["all"] == {"successes": 7, "trials": 11}
        assert (cell["agreement"], cell["successes"]["seeds"]) == ("differs", [])
        assert cell["agreement_p"] == pytest.approx(fisher_test(198, 220, 7, 11))
    elif format_name == "csv":
        assert ",7,11," in text and "differs" in text
    else:
        assert "7/11" in text


def test_the_robot_table_of_the_seed_paper_is_matched_by_environment_and_group() -> None:
    records = [
        make_counted(endings(9, 10), row=row, group=group, task=f"some name {row} {group}")
        for row, group in (("safe-manipulation", "few-uniform"), ("dynamic-hitting", "400-expert-hit"))
    ]
    shown = with_publication(build_table(records, rule=FISHER), read_publication("dilo-2024"), 5.0, anyway=True)
    texts = [str(cell_text(cell)).split()[0] for _, column, cell in shown.cells() if cell and not column.run_here]
    assert texts == ["5/10", "9/10"]


def test_every_row_of_the_robot_table_can_be_matched() -> None:
    found = published_counts(read_publication("dilo-2024"))
    assert len(found.counts) == 30
    assert ("puck-striking", "20-expert", "bco") in found.counts


def test_nothing_published_is_said(table: Table) -> None:
    with pytest.raises(UserError, match=r"no number for any task and method.*methods somebody"):
        with_publication(table, publication(somebody=(1, 2)), 5.0, anyway=True)
    with pytest.raises(UserError, match="no table of successes with the columns task, dataset"):
        with_publication(table, publication({"env": "hopper"}, dilo=(1, 2)), 5.0, anyway=True)
    means = TableOfMeans("Table 1", (PublishedRow(FIELDS, {"dilo": PrintedMean(1.0, 1.0, 0.1, 0.1, 5, None)}),))
    with pytest.raises(UserError, match="no table of successes"):
        with_publication(table, Publication("paper", "", (means,)), 5.0, anyway=True)


def test_two_variants_of_a_method_are_ambiguous() -> None:
    records = [make_counted(endings(9, 10)), make_counted(endings(9, 10), preset="paper")]
    with pytest.raises(UserError, match="dilo:released and dilo:paper would both be compared"):
        with_publication(build_table(records, rule=FISHER), publication(dilo=(1, 2)), 5.0, anyway=True)


def test_counts_are_not_held_against_scores() -> None:
    scores = build_table([make_counted(endings(9, 10), seed=seed) for seed in range(2)])
    with pytest.raises(UserError, match=r"counts successes on these tasks, and --test welch shows scores.*Leave out"):
        with_publication(scores, publication(dilo=(1, 2)), 5.0, anyway=True)
    with pytest.raises(UserError, match="no table that says which source"):
        with_publication(build_table(make_cell([1.0, 2.0])), publication(dilo=(1, 2)), 5.0, anyway=True)


def test_a_cell_of_failures_alone_is_shown_without_a_verdict(table: Table) -> None:
    published = publication({"task": "safe-manipulation", "dataset": "fixed-start"}, bco=(1, 2))
    shown = with_publication(table, published, 5.0, anyway=True)
    assert published_cells(shown)["safe-manipulation-fixed-start", "bco"] == (None, None)
