"""The table in GitHub-flavoured Markdown; highlighted cells are bold."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from lfobench.tables.table import MISSING, Cell, ColumnKind, Note, Table, cell_text
from lfobench.text import harmless

_KINDS: dict[ColumnKind, tuple[str, str]] = {
    "actions": ("§", "has access to expert actions"),
    "published": ("¶", "as published"),
    "incomparable": ("¶", "as published, not comparable"),
}


def export(table: Table) -> str:
    """A Markdown table followed by its notes as a list.

    Markdown has no column groups, so methods with access to expert actions carry a mark instead.
    """
    headings = [
        f"{escape(column.label)}{f' {_KINDS[column.kind][0]}' if column.kind in _KINDS else ''}"
        for column in table.columns
    ]
    rows = (
        ["" if index else escape(block.label), escape(row.label), *map(_cell, row.cells)]
        for block in table.blocks
        for index, row in enumerate(block.rows)
    )
    kinds = {column.kind for column in table.columns}
    marks = [f"- {mark} {meaning}" for kind, (mark, meaning) in _KINDS.items() if kind in kinds]
    lines = _lines(["Dataset", "Task", *headings], rows, left=2)
    return "\n".join([*lines, "", *marks, *note_lines(table.notes)]) + "\n"


def _cell(cell: Cell | None) -> str:
    if cell is None:
        return MISSING
    text = str(cell_text(cell))
    return f"**{text}**" if cell.highlighted else text


def table_lines(headings: Sequence[str], rows: Iterable[Sequence[str]], left: int) -> Iterator[str]:
    """A table of text, its first `left` columns aligned at the left."""
    return _lines([*map(escape, headings)], ([*map(escape, row)] for row in rows), left)


def _lines(headings: Sequence[str], rows: Iterable[Sequence[str]], left: int) -> Iterator[str]:
    rule = [":--"] * left + ["--:"] * (len(headings) - left)
    return (f"| {' | '.join(fields)} |" for fields in (headings, rule, *rows))


def note_lines(notes: Iterable[Note]) -> Iterator[str]:
    """Notes as a list."""
    return (f"- **{escape(note.label)}**: {escape(note.text)}" for note in notes)


def escape(text: str) -> str:
    """Text that Markdown shows as it is written, on one line."""
    # A "<" before a blank or a digit opens no tag; leaving it alone keeps "p < 0.05" readable as source.
    return re.sub(r"([\\`*_\[\]>|~#&]|<(?=[A-Za-z/!?]))", r"\\\1", harmless(" ".join(text.split())))
