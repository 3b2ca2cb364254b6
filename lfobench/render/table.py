"""The table model: what every exporter draws, and nothing about how."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lfobench.contract.record import Statistic
from lfobench.stats.highlight import Verdict
from lfobench.stats.summary import Summary

HIGHLIGHT_NOTE = "Highlighted"
"""Label of the note that explains the highlights; the terminal attaches its mark to it."""


@dataclass(frozen=True)
class Column:
    """One method under one preset and one set of options.

    Attributes:
        label: unique in its table; the method's name, extended only as far as another column requires.
        method: name of the method.
        preset: name of its preset.
        sees_expert_actions: whether the method was given expert actions; decides the column group.
    """

    label: str
    method: str
    preset: str
    sees_expert_actions: bool


@dataclass(frozen=True)
class Cell:
    """Normalised scores of one column on one task, over seeds.

    Attributes:
        summary: n, mean and std over seeds; a diverged seed is one of them, with score 0.
        seeds: the seeds, ascending.
        diverged_seeds: those of them that diverged.
        highlighted: whether the highlight rule picks this cell.
    """

    summary: Summary
    seeds: tuple[int, ...]
    diverged_seeds: tuple[int, ...]
    highlighted: bool


@dataclass(frozen=True)
class Row:
    """One task.

    Attributes:
        label: short name inside the block, e.g. ``hopper``.
        task: full name, e.g. ``hopper-random-expert``.
        cells: one per column of the table; None where there is no record.
        verdict: outcome of the highlight rule.
        p: p-value behind the verdict; None where nothing was tested.
    """

    label: str
    task: str
    cells: tuple[Cell | None, ...]
    verdict: Verdict
    p: float | None


@dataclass(frozen=True)
class Block:
    """Rows under one heading, e.g. ``random+expert``."""

    label: str
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Note:
    """One entry of the footnote."""

    label: str
    text: str


@dataclass(frozen=True)
class ColumnGroup:
    """Neighbouring columns under one heading: ``columns[start:stop]``."""

    label: str
    start: int
    stop: int


@dataclass(frozen=True)
class Table:
    """Scores of methods (columns) on tasks (rows) from one source under one protocol."""

    columns: tuple[Column, ...]
    blocks: tuple[Block, ...]
    notes: tuple[Note, ...]
    statistic: Statistic
    source: str
    protocol: str

    def rows(self) -> Iterator[tuple[Block, Row]]:
        """Every row with its block, in table order."""
        for block in self.blocks:
            for row in block.rows:
                yield block, row

    def cells(self) -> Iterator[tuple[Row, Column, Cell | None]]:
        """Every cell with its row and column, row by row."""
        for _, row in self.rows():
            for column, cell in zip(self.columns, row.cells, strict=True):
                yield row, column, cell


def column_groups(columns: tuple[Column, ...]) -> tuple[ColumnGroup, ...]:
    """The seed paper's two column groups, methods with expert actions first; an empty group is left out."""
    with_actions = sum(column.sees_expert_actions for column in columns)
    groups = (
        ColumnGroup("Access to expert actions", 0, with_actions),
        ColumnGroup("No expert actions", with_actions, len(columns)),
    )
    return tuple(group for group in groups if group.start < group.stop)
