"""Published columns: scores."""

from __future__ import annotations

import io
from collections.abc import Callable

import pytest
from rich.console import Console

from lfobench.errors import UserError
from lfobench.record import Record
from lfobench.stats.intervals import Summary
from lfobench.tables.building import build_table
from lfobench.tables.exporters import FORMATS, export
from lfobench.tables.exporters.terminal import terminal
from lfobench.tables.published_columns import PublishedScores, with_published
from lfobench.tables.table import Table, column_groups

HOPPER, ANT = "hopper-random-expert", "ant-random-expert"


def published(source: str = "generated", protocol: str = "quick", **scores: Summary) -> PublishedScores:
    return PublishedScores(
        "paper, Table 1", source, protocol, {(HOPPER, name): score for name, score in scores.items()}, "n = 5."
    )


@pytest.fixture
def table(make_cell: Callable[..., list[Record]]) -> Table:
    return build_table(
        make_cell([90.0, 91.0, 92.0, 90.5, 91.5])
        + make_cell([60.0, 75.0, 30.0, 44.0, 51.0], "oril")
        + make_cell([7.0, 8.0, 9.0], "new-method")
        + make_cell([50.0, 51.0, 52.0], row="ant")
    )


def agreements(table: Table) -> dict[tuple[str, str], object]:
    return {
        (row.task, column.label): cell.agreement if cell else None
        for row, column, cell in table.cells()
        if not column.run_here
    }


def test_every_verdict(table: Table) -> None:
    theirs = published(dilo=Summary(5, 92.0, 0.8), oril=Summary(5, 60.0, 15.0))
    found = agreements(with_published(table, theirs, margin=5.0, alpha=0.05, anyway=False))
    assert found == {
        (HOPPER, "dilo"): "matches",
        (HOPPER, "oril"): "undecided",
        (ANT, "dilo"): None,
        (ANT, "oril"): None,
    }
    far = published(dilo=Summary(5, 70.0, 2.0))
    assert agreements(with_published(table, far, 5.0, 0.05, False))[HOPPER, "dilo"] == "differs"


def test_a_wider_margin_turns_differs_into_matches(table: Table) -> None:
    theirs = published(dilo=Summary(5, 70.0, 2.0))
    assert agreements(with_published(table, theirs, 40.0, 0.05, False))[HOPPER, "dilo"] == "matches"


def test_published_columns_change_nothing_of_ours(table: Table) -> None:
    shown_with_published = with_published(table, published(dilo=Summary(5, 120.0, 1.0)), 5.0, 0.05, False)
    assert shown_with_published.columns[: len(table.columns)] == table.columns
    for (_, before), (_, after) in zip(table.rows(), shown_with_published.rows(), strict=True):
        assert after.cells[: len(before.cells)] == before.cells
        assert (after.p, after.outcome) == (before.p, before.outcome)
    assert [group.label for group in column_groups(shown_with_published.columns)] == ["No expert actions", "Published"]


@pytest.mark.parametrize(
    ("source", "protocol", "said"),
    [
        ("d4rl", "quick", "the source is 'generated' here and 'd4rl' there"),
        ("generated", "paper", "the protocol is 'quick' here and 'paper' there"),
        ("d4rl", "paper", "and the protocol is"),
    ],
)
def test_other_conditions_are_refused_unless_asked_for_and_then_labelled(
    table: Table, source: str, protocol: str, said: str
) -> None:
    theirs = published(source, protocol, dilo=Summary(5, 92.0, 0.8))
    with pytest.raises(UserError, match="--anyway") as refused:
        with_published(table, theirs, 5.0, 0.05, anyway=False)
    assert said in str(refused.value)
    shown = with_published(table, theirs, 5.0, 0.05, anyway=True)
    assert column_groups(shown.columns)[-1].label == "Published, not comparable"
    assert said in next(note.text for note in shown.notes if note.label == "Not comparable")


def test_nothing_published_is_said(table: Table) -> None:
    with pytest.raises(UserError, match="has no number for any task and method"):
        with_published(table, published(somebody=Summary(5, 1.0, 1.0)), 5.0, 0.05, False)


def test_two_variants_of_a_method_are_ambiguous(make_cell: Callable[..., list[Record]]) -> None:
    table = build_table(make_cell([1.0, 2.0]) + make_cell([1.0, 2.0], preset="paper"))
    with pytest.raises(UserError, match="dilo:released and dilo:paper would both be compared"):
        with_published(table, published(dilo=Summary(5, 1.0, 1.0)), 5.0, 0.05, False)


def test_one_seed_of_ours_decides_nothing(make_record: Callable[..., Record]) -> None:
    found = with_published(build_table([make_record(92.0)]), published(dilo=Summary(5, 92.0, 0.8)), 5.0, 0.05, False)
    assert agreements(found) == {(HOPPER, "dilo"): "undecided"}


@pytest.mark.parametrize("format_name", [*FORMATS, "terminal"])
def test_every_format_shows_published_columns_and_the_margin(table: Table, format_name: str) -> None:
    shown_with_published = with_published(table, published(dilo=Summary(5, 92.0, 0.8)), 4.5, 0.05, False)
    if format_name == "terminal":
        console = Console(file=io.StringIO(), width=120, color_system=None)
        console.print(terminal(shown_with_published))
        assert isinstance(console.file, io.StringIO)
        text = console.file.getvalue()
        assert "92.0 ± 0.8 ≈" in text
    else:
        text = export(shown_with_published, format_name)
        assert "92.0" in text
    if format_name == "csv":
        assert "matches" in text
    else:
        assert "below 4.5 points" in " ".join(text.split())
