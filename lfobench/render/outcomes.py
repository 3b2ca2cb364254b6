"""How episodes ended: for every task and method, each outcome with its count."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lfobench.contract.failure import Failure
from lfobench.contract.record import SUCCESS, Record
from lfobench.contract.statistic import SUCCESS_RATE
from lfobench.render.building import build_table
from lfobench.render.columns import arrange_columns
from lfobench.render.counting import (
    DIVERGED_OUTCOME,
    LEAVE_OUT,
    check_outcomes,
    fixed_outcomes,
    further_outcomes,
)
from lfobench.render.table import HIGHLIGHT_NOTE, Cell, Column, Note, Row
from lfobench.stats.highlight import Rule

_ABOUT_NUMBERS = frozenset({"Score", "Episodes", HIGHLIGHT_NOTE, "†", "Design", "Demonstration"})
"""Notes of a table of success counts that say nothing of how episodes ended."""


@dataclass(frozen=True)
class Line:
    """One method on one task.

    Attributes:
        group: block of the task.
        row: the task.
        column: the method.
        cell: its seeds, and which of them diverged or failed; None where there is no record.
        counts: episodes by outcome, those of the table's outcomes that occur.
    """

    group: str
    row: Row
    column: Column
    cell: Cell | None
    counts: Mapping[str, int]

    @property
    def episodes(self) -> int:
        """All of them."""
        return sum(self.counts.values())

    def percent(self, outcome: str) -> float:
        """Episodes that ended so, in per cent of all; there must be any."""
        return 100.0 * self.counts.get(outcome, 0) / self.episodes


@dataclass(frozen=True)
class OutcomeTable:
    """Every task and method.

    Attributes:
        outcomes: success first, then the failures, the most frequent first; diverged seeds' episodes last.
        lines: task by task, the methods in column order.
        notes: the footnote.
        source: where the data came from.
        protocol: name of the protocol.
    """

    outcomes: tuple[str, ...]
    lines: tuple[Line, ...]
    notes: tuple[Note, ...]
    source: str
    protocol: str


def outcome_table(
    records: Sequence[Record],
    tasks: Sequence[str] = (),
    methods: Sequence[str] = (),
    failures: Sequence[Failure] = (),
) -> OutcomeTable:
    """How the episodes behind success counts ended; arguments as of `build_table`.

    Raises:
        UserError: there are no records, they must not share a table, or some do not say how their episodes ended.
    """
    if records:
        check_outcomes(records, "--outcomes counts how episodes ended", LEAVE_OUT.capitalize())
    table = build_table(records, SUCCESS_RATE, Rule("fisher"), tasks, methods, failures)
    members = arrange_columns(records, methods)
    lines = tuple(
        Line(
            block.label,
            row,
            column,
            cell,
            _counts([record for record in members.get(column, []) if record.task == row.task]),
        )
        for block, row in table.rows()
        for column, cell in zip(table.columns, row.cells, strict=True)
        if column.run_here
    )
    about = Note(
        "Outcomes",
        "episodes that ended so, and their part of all episodes of the task and method, pooled over seeds: those of "
        "the last evaluation and, where a task has further starts, of the trained policy from them.",
    )
    notes = (about, *(note for note in table.notes if note.label not in _ABOUT_NUMBERS))
    return OutcomeTable(_in_order(lines), lines, notes, table.source, table.protocol)


def _counts(records: Sequence[Record]) -> Counter[str]:
    return Counter(outcome for record in records for outcome in [*fixed_outcomes(record), *further_outcomes(record)])


def _in_order(lines: Sequence[Line]) -> tuple[str, ...]:
    total: Counter[str] = Counter()
    for line in lines:
        total.update(line.counts)
    failures = sorted(total.keys() - {SUCCESS}, key=lambda each: (each == DIVERGED_OUTCOME, -total[each], each))
    return (SUCCESS, *failures)
