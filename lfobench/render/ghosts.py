"""Ghost columns: published numbers beside ours, one column for every method of the table that was published."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from lfobench.errors import UserError
from lfobench.render.table import Block, Cell, Column, ColumnKind, Note, Row, Table

Ghost = Callable[[Block, Row, Column, Cell | None], Cell | None]
"""The published cell beside ours: given its block, row and column, and what stands in it."""


def published_columns(table: Table, name: str, here: Collection[str], methods: Collection[str]) -> list[Column]:
    """Our columns that published numbers are held against.

    Args:
        table: ours.
        name: of the published table.
        here: methods that it has on a task of ours.
        methods: all that it has.

    Raises:
        UserError: it has nothing of ours, or two columns show one method, so that a verdict would be ambiguous.
    """
    columns = [column for column in table.columns if column.run_here and column.method in here]
    if not columns:
        raise UserError(
            f"{name} has no number for any task and method of this table.",
            f"It has the methods {', '.join(sorted(methods))}.",
        )
    names = [column.method for column in columns]
    repeated = next((method for method in names if names.count(method) > 1), None)
    if repeated is not None:
        labels = " and ".join(column.label for column in columns if column.method == repeated)
        raise UserError(
            f"{labels} would both be held against the published {repeated}.", "Choose one, e.g. with --preset released."
        )
    return columns


def with_ghosts(table: Table, beside: Sequence[Column], comparable: bool, ghost: Ghost, notes: Sequence[Note]) -> Table:
    """`table` with a ghost column for each of `beside`, and more notes."""
    kind: ColumnKind = "published" if comparable else "incomparable"
    ghosts = {column: Column(column.method, column.method, "", kind) for column in beside}
    blocks = tuple(
        replace(block, rows=tuple(_with_ghosts(block, row, table.columns, beside, ghost) for row in block.rows))
        for block in table.blocks
    )
    return replace(table, columns=(*table.columns, *ghosts.values()), blocks=blocks, notes=(*table.notes, *notes))


def _with_ghosts(block: Block, row: Row, columns: Sequence[Column], beside: Sequence[Column], ghost: Ghost) -> Row:
    added = [
        ghost(block, row, column, cell) for column, cell in zip(columns, row.cells, strict=True) if column in beside
    ]
    return replace(row, cells=(*row.cells, *added))
