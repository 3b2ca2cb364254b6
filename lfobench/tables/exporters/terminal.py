"""The table on a terminal: numbers aligned at the decimal point, in compact cells where wide ones do not fit."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.text import Text

from lfobench.tables.document import wrapped
from lfobench.tables.table import (
    GROUP_LABELS,
    HIGHLIGHT_NOTE,
    MISSING,
    PLUS_MINUS,
    Column,
    ColumnGroup,
    Note,
    Table,
    cell_text,
    column_groups,
    compact_text,
)
from lfobench.text import harmless

_GAP = 2
_HIGHLIGHT = "bold green"


COMPACT = Note("Cells", "compact, to fit the terminal; --wide shows intervals and counts.")
DEMONSTRATION = "expert"
"""Heading of the demonstration's column where cells are compact."""
COMPACT_LABELS = {GROUP_LABELS["actions"]: "expert actions", GROUP_LABELS["expert"]: ""}
"""Label of a group of columns to the one above compact cells."""


def terminal(table: Table, wide: bool = False) -> RenderableType:
    """The table as ``Console.print`` takes it.

    Highlighted numbers are bold and green; on a console without styles (a pipe, a log) they carry a `*`. Where not all
    columns fit beside each other, cells are compact, a success rate in whole per cent without its interval; if `wide`,
    they are not. Columns that do not fit then follow below.
    """
    return _TerminalTable(table, wide)


class _TerminalTable:
    def __init__(self, table: Table, wide: bool) -> None:
        self.table = table
        self.wide = wide

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        highlight_mark = "*" if console.color_system is None else ""
        drawing = _Drawing(self.table, highlight_mark)
        for gap in () if self.wide else (_GAP, 1):
            if len(list(drawing.parts(options.max_width))) > 1:
                drawing = _Drawing(self.table, highlight_mark, compact=True, gap=gap)
        for start, stop in drawing.parts(options.max_width):
            yield from drawing.part(start, stop)
            yield Text()
        notes = [COMPACT] if drawing.compact else []
        notes += [
            Note(note.label + highlight_mark * (note.label == HIGHLIGHT_NOTE), note.text) for note in self.table.notes
        ]
        yield from wrapped(notes, options.max_width)


class _Drawing:
    """The lines of a table. Column widths are in terminal cells."""

    def __init__(self, table: Table, highlight_mark: str, compact: bool = False, gap: int = _GAP) -> None:
        self.table = table
        self.compact = compact
        self.gap = gap
        self.cells = [_aligned_cells(table, index, highlight_mark, compact) for index in range(len(table.columns))]
        blocks = [cell_len(harmless(block.label)) for block in table.blocks]
        self.stub_width = max(*blocks, *(cell_len(harmless(row.label)) + _GAP for _, row in table.rows()))

    def parts(self, width: int) -> Iterator[tuple[int, int]]:
        """Ranges of columns that fit `width` after the row labels; at least one column each."""
        start = 0
        for stop in range(1, len(self.cells)):
            if self._total(self._widths(start, stop + 1)) > width:
                yield start, stop
                start = stop
        yield start, len(self.cells)

    def part(self, start: int, stop: int) -> Iterator[Text]:
        """The lines of ``columns[start:stop]``: headings, then blocks of rows."""
        columns, widths = self.table.columns[start:stop], self._widths(start, stop)
        rule = Text("─" * self._total(widths), "dim", no_wrap=True, overflow="ignore")
        yield from self._headings(columns, widths)
        yield rule
        position = 0
        for block in self.table.blocks:
            yield Text(harmless(block.label), "bold", no_wrap=True, overflow="ignore")
            for row in block.rows:
                yield self._line(
                    " " * _GAP + harmless(row.label), [cells[position] for cells in self.cells[start:stop]], widths
                )
                position += 1
        yield rule

    def _headings(self, columns: tuple[Column, ...], widths: list[int]) -> Iterator[Text]:
        groups = column_groups(columns)
        spans = [self._span(group, widths) for group in groups]
        labels = [self._group_lines(group, span) for group, span in zip(groups, spans, strict=True)]
        height = max(map(len, labels))
        for index in range(height):
            names = Text(" " * self.stub_width, no_wrap=True, overflow="ignore")
            for lines, span in zip(labels, spans, strict=True):
                line = index - (height - len(lines))
                name = Text(lines[line] if line >= 0 else "", "italic")
                name.align("center", span)
                names.append(" " * self.gap).append_text(name)
            names.rstrip()
            yield names
        rules = Text(" " * self.stub_width, no_wrap=True)
        for span in spans:
            rules.append(" " * self.gap).append("─" * span, "dim")
        yield rules
        yield self._line("", [Text(self._label(column), "bold") for column in columns], widths)

    def _label(self, column: Column) -> str:
        return DEMONSTRATION if self.compact and column.kind == "expert" else column.label

    def _group_lines(self, group: ColumnGroup, width: int) -> list[str]:
        """The heading of a group; in a compact table on as many lines as it takes."""
        if not self.compact:
            return [group.label]
        return textwrap.wrap(COMPACT_LABELS.get(group.label, group.label), width, break_long_words=False) or [""]

    def _line(self, stub: str, cells: list[Text], widths: list[int]) -> Text:
        line = Text(stub, no_wrap=True, overflow="ignore")
        line.pad_right(self.stub_width - cell_len(stub))
        for cell, width in zip(cells, widths, strict=True):
            line.append(" " * (self.gap + width - cell.cell_len)).append_text(cell)
        line.rstrip()
        return line

    def _widths(self, start: int, stop: int) -> list[int]:
        """Widths of ``columns[start:stop]``, the first of a group widened where the group's heading needs it."""
        columns = self.table.columns[start:stop]
        widths = [
            max(cell_len(self._label(column)), *(cell.cell_len for cell in cells))
            for column, cells in zip(columns, self.cells[start:stop], strict=True)
        ]
        for group in column_groups(columns):
            needed = max(map(cell_len, self._group_lines(group, self._span(group, widths))))
            widths[group.start] += max(0, needed - self._span(group, widths))
        return widths

    def _span(self, group: ColumnGroup, widths: list[int]) -> int:
        return sum(widths[group.start : group.stop]) + self.gap * (group.stop - group.start - 1)

    def _total(self, widths: list[int]) -> int:
        return self.stub_width + sum(self.gap + width for width in widths)


def _aligned_cells(table: Table, column: int, highlight_mark: str, compact: bool) -> list[Text]:
    """The cells of one column, all of one width and aligned at their decimal points."""
    cells = [row.cells[column] for _, row in table.rows()]
    texts = [(compact_text(cell) if compact else cell_text(cell)) if cell else None for cell in cells]
    around = "" if compact else " "
    mean = max((len(text.mean) for text in texts if text), default=0)
    std = max((len(text.std) for text in texts if text), default=0)
    interval = max((len(text.interval) for text in texts if text), default=0)
    marks = max((cell_len(text.marks) for text in texts if text), default=0)
    lost = max((len(text.lost) for text in texts if text), default=0)
    star = highlight_mark if any(cell and cell.highlighted for cell in cells) else ""
    aligned = []
    for cell, text in zip(cells, texts, strict=True):
        highlighted = cell is not None and cell.highlighted
        spread = f"{around}{PLUS_MINUS}{around}{text.std:>{std}}" if text and text.std else ""
        spread = spread.ljust(std + 1 + 2 * len(around) if std else 0)
        if interval:
            spread += f" {text.interval if text else '':>{interval}}"
        line = Text((text.mean if text else MISSING).rjust(mean) + spread)
        line.stylize(_HIGHLIGHT if highlighted else "" if table.columns[column].run_here else "dim")
        line.append((text.lost if text else "").ljust(lost))
        line.append(star if highlighted else " " * len(star))
        line.append(f" {text.marks if text else ''}".ljust(marks + 1) if marks else "", "red")
        aligned.append(line)
    return aligned
