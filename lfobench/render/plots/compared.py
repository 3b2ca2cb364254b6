"""What a comparison over tasks is made of: the tasks on which every method has a score."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lfobench.errors import UserError
from lfobench.render.table import Cell, Column, Row, Table

LEVEL = 0.95
"""Nominal coverage of every interval and band that is drawn."""


@dataclass(frozen=True)
class Compared:
    """Methods on the tasks that they share; other tasks would favour whoever was spared them.

    Attributes:
        scores: the scores over seeds ``[n]`` of each task, by column.
        tasks: the tasks, in row order.
        left_out: tasks on which a method has no score.
    """

    scores: Mapping[Column, Sequence[Sequence[float]]]
    tasks: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def columns(self) -> tuple[Column, ...]:
        """The methods, in table order."""
        return tuple(self.scores)


def run_columns(table: Table) -> tuple[Column, ...]:
    """The columns of methods that were run here."""
    return tuple(column for column in table.columns if column.run_here)


def run_cells(table: Table, row: Row) -> dict[Column, Cell]:
    """The cells of a row that runs stand behind, failed ones included."""
    return {
        column: cell
        for column, cell in zip(table.columns, row.cells, strict=True)
        if column.run_here and cell is not None
    }


def demonstration_score(table: Table, row: Row) -> float | None:
    """Score of the demonstration that the methods observe on a task, where the table knows it."""
    return next(
        (
            cell.summary.mean
            for column, cell in zip(table.columns, row.cells, strict=True)
            if column.kind == "expert" and cell is not None and cell.summary is not None
        ),
        None,
    )


def compare(table: Table) -> Compared:
    """The scores of all methods of `table` on the tasks that they share; methods without any score take no part.

    Raises:
        UserError: there is no such task.
    """
    scored = {column for _, column, cell in table.cells() if cell is not None and cell.sample is not None}
    columns = tuple(column for column in run_columns(table) if column in scored)
    shared, left_out = {}, []
    for _, row in table.rows():
        samples = {column: cell.sample for column, cell in run_cells(table, row).items() if cell.sample is not None}
        if len(samples) == len(columns):
            shared[row.task] = samples
        else:
            left_out.append(row.task)
    if not shared:
        raise UserError(
            f"On no task do all of {', '.join(column.label for column in columns)} have a score.",
            "Name the methods to compare with --methods, or run what is missing.",
        )
    return Compared(
        {column: [samples[column].seeds for samples in shared.values()] for column in columns},
        tuple(shared),
        tuple(left_out),
    )
