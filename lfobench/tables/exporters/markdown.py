"""The table in GitHub-flavoured Markdown; highlighted cells are bold."""

from __future__ import annotations

import re

from lfobench.tables.table import MISSING, Cell, ColumnKind, Table, cell_text
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
    lines = [_line(["Dataset", "Task", *headings]), _line([":--", ":--", *["--:"] * len(headings)])]
    for block in table.blocks:
        for index, row in enumerate(block.rows):
            dataset = "" if index else escape(block.label)
            lines.append(_line([dataset, escape(row.label), *(_cell(cell) for cell in row.cells)]))
    notes = [f"- **{escape(note.label)}**: {escape(note.text)}" for note in table.notes]
    kinds = {column.kind for column in table.columns}
    notes = [*(f"- {mark} {meaning}" for kind, (mark, meaning) in _KINDS.items() if kind in kinds), *notes]
    return "\n".join([*lines, "", *notes]) + "\n"


def _line(fields: list[str]) -> str:
    return f"| {' | '.join(fields)} |"


def _cell(cell: Cell | None) -> str:
    if cell is None:
        return MISSING
    text = str(cell_text(cell))
    return f"**{text}**" if cell.highlighted else text


def escape(text: str) -> str:
    """Text that Markdown shows as it is written, on one line."""
    # A "<" before a blank opens no tag; leaving it alone keeps "p < 0.05" readable as source.
    return re.sub(r"([\\`*_\[\]>|~#&]|<(?! ))", r"\\\1", harmless(" ".join(text.split())))
