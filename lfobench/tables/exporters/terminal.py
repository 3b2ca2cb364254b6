"""The table on a terminal: numbers aligned at the decimal point, wide tables cut into parts that fit."""

from __future__ import annotations

from collections.abc import Iterator

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.text import Text

from lfobench.tables.document import wrapped
from lfobench.tables.table import (
    HIGHLIGHT_NOTE,
    MISSING,
    PLUS_MINUS,
    Column,
    ColumnGroup,
    Note,
    Table,
    cell_text,
    column_groups,
)
from lfobench.text import harmless

_GAP = 2
_HIGHLIGHT = "bold green"


def terminal(table: Table) -> RenderableType:
    """The table as ``Console.print`` takes it.

    Highlighted numbers are bold and green; on a console without styles (a pipe, a log) they carry a `*`.
    """
    return _TerminalTable(table)


class _TerminalTable:
    def __init__(self, table: Table) -> None:
        self.table = table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        highlight_mark = "*" if console.color_system is None else ""
        drawing = _Drawing(self.table, highlight_mark)
        for start, stop in drawing.parts(options.max_width):
            yield from drawing.part(start, stop)
            yield Text()
        notes = [
            Note(note.label + highlight_mark * (note.label == HIGHLIGHT_NOTE), note.text) for note in self.table.notes
        ]
        yield from wrapped(notes, options.max_width)


class _Drawing:
    """The lines of a table. Column widths are in terminal cells."""

    def __init__(self, table: Table, highlight_mark: str) -> None:
        self.table = table
        self.cells = [_aligned_cells(table, index, highlight_mark) for index in range(len(table.columns))]
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
        names, rules = (
            Text(" " * self.stub_width, no_wrap=True, overflow="ignore"),
            Text(" " * self.stub_width, no_wrap=True),
        )
        for group in column_groups(columns):
            name = Text(group.label, "italic")
            name.align("center", _span(group, widths))
            names.append(" " * _GAP).append_text(name)
            rules.append(" " * _GAP).append("─" * _span(group, widths), "dim")
        names.rstrip()
        yield names
        yield rules
        yield self._line("", [Text(column.label, "bold") for column in columns], widths)

    def _line(self, stub: str, cells: list[Text], widths: list[int]) -> Text:
        line = Text(stub, no_wrap=True, overflow="ignore")
        line.pad_right(self.stub_width - cell_len(stub))
        for cell, width in zip(cells, widths, strict=True):
            line.append(" " * (_GAP + width - cell.cell_len)).append_text(cell)
        line.rstrip()
        return line

    def _widths(self, start: int, stop: int) -> list[int]:
        """Widths of ``columns[start:stop]``, the first of a group widened where the group's heading needs it."""
        columns = self.table.columns[start:stop]
        widths = [
            max(cell_len(column.label), *(cell.cell_len for cell in cells))
            for column, cells in zip(columns, self.cells[start:stop], strict=True)
        ]
        for group in column_groups(columns):
            widths[group.start] += max(0, cell_len(group.label) - _span(group, widths))
        return widths

    def _total(self, widths: list[int]) -> int:
        return self.stub_width + sum(_GAP + width for width in widths)


def _span(group: ColumnGroup, widths: list[int]) -> int:
    return sum(widths[group.start : group.stop]) + _GAP * (group.stop - group.start - 1)


def _aligned_cells(table: Table, column: int, highlight_mark: str) -> list[Text]:
    """The cells of one column, all of one width and aligned at their decimal points."""
    cells = [row.cells[column] for _, row in table.rows()]
    texts = [cell_text(cell) if cell else None for cell in cells]
    mean = max((len(text.mean) for text in texts if text), default=0)
    std = max((len(text.std) for text in texts if text), default=0)
    interval = max((len(text.interval) for text in texts if text), default=0)
    marks = max((cell_len(text.marks) for text in texts if text), default=0)
    lost = max((len(text.lost) for text in texts if text), default=0)
    star = highlight_mark if any(cell and cell.highlighted for cell in cells) else ""
    aligned = []
    for cell, text in zip(cells, texts, strict=True):
        highlighted = cell is not None and cell.highlighted
        spread = f" {PLUS_MINUS} {text.std:>{std}}" if text and text.std else ""
        spread = spread.ljust(std + 3 if std else 0)
        if interval:
            spread += f" {text.interval if text else '':>{interval}}"
        line = Text((text.mean if text else MISSING).rjust(mean) + spread)
        line.stylize(_HIGHLIGHT if highlighted else "" if table.columns[column].run_here else "dim")
        line.append((text.lost if text else "").ljust(lost))
        line.append(star if highlighted else " " * len(star))
        line.append(f" {text.marks if text else ''}".ljust(marks + 1) if marks else "", "red")
        aligned.append(line)
    return aligned
