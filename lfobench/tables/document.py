"""A document of headings, paragraphs, grids of text and notes: printed on a terminal, or as Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import TypeAlias

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from lfobench.tables.exporters import markdown
from lfobench.tables.table import Note
from lfobench.text import harmless

_GAP = 2
_NARROWEST_NOTE = 20


@dataclass(frozen=True)
class Heading:
    """A heading of level 1 or 2; a terminal leaves out the first level, which repeats the command."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraphs:
    """Paragraphs of one style, a style of rich's."""

    texts: tuple[str, ...]
    style: str = ""


@dataclass(frozen=True)
class Section:
    """Rows under one heading.

    Attributes:
        heading: above them; empty for none.
        style: of the heading, a style of rich's.
        rows: name of each row, then its cells, one per column.
    """

    heading: str
    style: str
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Grid:
    """Sections of rows in common columns.

    Attributes:
        columns: names of the cells, without the row's name.
        sections: at least one.
        stubs: in Markdown, names of a column of sections and of the column of rows; a grid of one section needs none.
    """

    columns: Sequence[str]
    sections: Sequence[Section]
    stubs: tuple[str, str] | None = None


@dataclass(frozen=True)
class Notes:
    """Notes, each under its label."""

    notes: Sequence[Note]


@dataclass(frozen=True)
class Items:
    """A list."""

    texts: tuple[str, ...]


Part: TypeAlias = Heading | Paragraphs | Grid | Notes | Items


@dataclass(frozen=True)
class Document:
    """Parts from top to bottom; ``Console.print`` draws it."""

    parts: tuple[Part, ...]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        shown = [part for part in self.parts if not (isinstance(part, Heading) and part.level == 1)]
        for index, part in enumerate(shown):
            if index and not isinstance(shown[index - 1], Heading):
                yield Text()
            yield from _lines(part, options.max_width)

    def markdown(self) -> str:
        """The document in GitHub-flavoured Markdown."""
        return "\n".join(line for part in self.parts for line in (*_markdown(part), "")).rstrip("\n") + "\n"


def _lines(part: Part, width: int) -> Iterator[Text]:
    if isinstance(part, Heading):
        yield Text(harmless(part.text), "bold")
    elif isinstance(part, Paragraphs):
        for text in part.texts:
            # A task's name is easier to read and to search for in one piece.
            yield from (Text(line, part.style) for line in wrap(harmless(text), width, break_on_hyphens=False))
    elif isinstance(part, Grid):
        yield from aligned(part.columns, part.sections, width)
    elif isinstance(part, Notes):
        yield from wrapped(part.notes, width)
    else:
        yield from wrapped([Note("-", text) for text in part.texts], width)


def aligned(columns: Sequence[str], sections: Sequence[Section], width: int) -> Iterator[Text]:
    """The rows of all sections in common columns, right-aligned; `columns` names them, without the rows' names."""
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


def _cells(texts: Sequence[str], widths: Sequence[int]) -> str:
    return "".join(" " * (_GAP + width - cell_len(text)) + text for text, width in zip(texts, widths, strict=True))


def wrapped(notes: Sequence[Note], width: int) -> Iterator[Text]:
    """The notes, their texts wrapped in a column of their own, right of the labels."""
    labels = [harmless(note.label) for note in notes]
    indent = max(map(cell_len, labels), default=0) + _GAP
    for label, note in zip(labels, notes, strict=True):
        lines = wrap(harmless(note.text), max(width - indent, _NARROWEST_NOTE), break_on_hyphens=False)
        for index, line in enumerate(lines):
            yield Text(f"{'' if index else label:<{indent}}{line}", "dim")


def _markdown(part: Part) -> Iterator[str]:
    if isinstance(part, Heading):
        yield f"{'#' * part.level} {markdown.escape(part.text)}"
    elif isinstance(part, Paragraphs):
        yield from "\n\n".join(map(markdown.escape, part.texts)).split("\n")
    elif isinstance(part, Notes):
        yield from markdown.note_lines(part.notes)
    elif isinstance(part, Items):
        yield from (f"- {markdown.escape(text)}" for text in part.texts)
    elif part.stubs:
        rows = [
            ["" if index else section.heading, *row]
            for section in part.sections
            for index, row in enumerate(section.rows)
        ]
        yield from markdown.table_lines([*part.stubs, *part.columns], rows, left=2)
    else:
        (section,) = part.sections
        yield from markdown.table_lines([section.heading, *part.columns], section.rows, left=1)
