"""One side of a comparison: its cells that have scores, found by what was run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from lfobench.contract.failure import Failure
from lfobench.contract.record import Record, canonical_json
from lfobench.contract.statistic import Statistic
from lfobench.errors import UserError
from lfobench.render.building import build_table
from lfobench.render.columns import arrange_columns
from lfobench.render.table import Cell, Note
from lfobench.stats.highlight import DEFAULT_RULE, Rule

Variant: TypeAlias = tuple[str, ...]
"""What makes two columns of two folders the same: method, preset and what was set by hand, not their version."""

_SHARED_NOTES = ("Score", "Episodes", "Source", "Protocol", "Simulator", "Precision", "Diverged", "Failed")


@dataclass(frozen=True)
class Side:
    """What is compared: a folder or a method's column.

    Attributes:
        name: as the user called it.
        heading: short, over its numbers.
        records: its runs.
        failures: its crashed runs.
    """

    name: str
    heading: str
    records: Sequence[Record]
    failures: Sequence[Failure] = ()


@dataclass(frozen=True)
class Found:
    """A cell and the records behind it."""

    cell: Cell
    records: Sequence[Record]


Cells: TypeAlias = Mapping[tuple[str, Variant], Found]


def cells_of(side: Side, statistic: Statistic, tasks: Sequence[str], rule: Rule) -> tuple[Cells, tuple[Note, ...]]:
    """The cells of a side that have scores, in table order, and its footnote.

    Raises:
        UserError: records that must not share a table, or two variants of one cell that only their versions or
            configurations tell apart.
    """
    try:
        # Only whether successes are counted matters: a side has no highlights, which other tests could refuse.
        shown = Rule("fisher") if rule.test == "fisher" else DEFAULT_RULE
        table = build_table(side.records, statistic, shown, tasks, failures=side.failures)
    except UserError as error:
        raise UserError(f"{side.name}: {error.problem}", error.remedy) from error
    columns = arrange_columns(side.records)
    cells: dict[tuple[str, Variant], Found] = {}
    for row, column, cell in table.cells():
        if cell is None or cell.sample is None or column not in columns:
            continue
        records = [record for record in columns[column] if record.task == row.task]
        key = (row.task, variant_of(records[0]))
        if key in cells:
            raise UserError(
                f"{side.name} holds {column.method} on {row.task} in two versions or configurations.",
                "Put the records of one of them into a folder of their own.",
            )
        cells[key] = Found(cell, records)
    return cells, table.notes


def variant_of(run: Record | Failure) -> Variant:
    """The variant that a run belongs to."""
    return run.method, str(run.identity["preset"]), canonical_json(run.identity["set"])


def merged_notes(subject: Side, reference: Side, ours: Sequence[Note], theirs: Sequence[Note]) -> tuple[Note, ...]:
    """What both footnotes say once, what only one says with its side."""
    merged: list[Note] = []
    for label in _SHARED_NOTES:
        texts = {
            side.heading: note.text
            for side, notes in ((reference, theirs), (subject, ours))
            for note in notes
            if note.label == label
        }
        if len(texts) == 2 and len(set(texts.values())) == 1:
            merged.append(Note(label, next(iter(texts.values()))))
        else:
            merged += [Note(f"{label}, {heading}", text) for heading, text in texts.items()]
    return tuple(merged)
