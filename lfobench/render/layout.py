"""Lines for a terminal: rows of numbers in aligned columns, and notes wrapped beside their labels.

Where the terminal is too narrow for a row, what the row is about takes a line of its own above its numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import wrap

from rich.cells import cell_len
from rich.text import Text

from lfobench.render.table import Note
from lfobench.words import harmless

_GAP = 2
_NARROWEST_NOTE = 20


@dataclass(frozen=True)
class Section:
    """Rows under one heading.

    Attributes:
        heading: above them; empty for none.
        style: of the heading, in rich's words.
        rows: what each row is about, then its cells, one per column.
    """

    heading: str
    style: str
    rows: Sequence[Sequence[str]]


def aligned(columns: Sequence[str], sections: Sequence[Section], width: int) -> Iterator[Text]:
    """The rows of all sections in common columns, right-aligned; `columns` names them, without the first."""
    columns = [harmless(column) for column in columns]
    sections = [
        Section(harmless(each.heading), each.style, [[*map(harmless, row)] for row in each.rows]) for each in sections
    ]
    rows = [row for section in sections for row in section.rows]
    widths = [max(cell_len(text) for text in texts) for texts in zip(columns, *(row[1:] for row in rows), strict=True)]
    stub = max((_GAP + cell_len(row[0]) for row in rows), default=0)
    numbers = sum(_GAP + each for each in widths)
    narrow = stub + numbers > width
    indent = _GAP if narrow else stub
    yield Text(" " * indent + _cells(columns, widths), "bold", no_wrap=True, overflow="ignore")
    yield Text("─" * min(indent + numbers, width), "dim", no_wrap=True, overflow="ignore")
    for section in sections:
        if section.heading:
            yield Text(section.heading, section.style)
        for name, *cells in section.rows:
            label = " " * _GAP + name
            if narrow:
                yield Text(label)
            start = " " * indent if narrow else label + " " * (stub - cell_len(label))
            yield Text((start + _cells(cells, widths)).rstrip())


def wrapped(notes: Sequence[Note], width: int) -> Iterator[Text]:
    """The notes, their texts wrapped beside a column of labels."""
    indent = max((cell_len(note.label) for note in notes), default=0) + _GAP
    for note in notes:
        lines = wrap(harmless(note.text), max(width - indent, _NARROWEST_NOTE), break_on_hyphens=False)
        for index, line in enumerate(lines):
            yield Text(f"{'' if index else note.label:<{indent}}{line}", "dim")


def _cells(texts: Sequence[str], widths: Sequence[int]) -> str:
    return "".join(" " * (_GAP + width - cell_len(text)) + text for text, width in zip(texts, widths, strict=True))
