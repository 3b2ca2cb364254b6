"""The table in HTML: a fragment to paste into a page, and the rows that the report is built around."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from html import escape
from importlib.resources import files
from typing import TypeAlias

from lfobench.tables.table import (
    AGREEMENTS,
    DIVERGED,
    FAILED,
    MISSING,
    PLUS_MINUS,
    Cell,
    CellText,
    Note,
    Table,
    cell_text,
    column_groups,
)
from lfobench.text import harmless_lines

_VOID = frozenset({"br", "col", "input", "meta"})


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


Attribute: TypeAlias = str | float | bool | None


def element(tag: str, /, *content: str, **attributes: Attribute) -> Markup:
    """One element. Content that is not `Markup` is text.

    Underscores in attribute names become hyphens, and one at the end is dropped: ``class_``, ``data_row``. None and
    False leave an attribute out, True gives it no value.
    """
    start = f"<{tag}{''.join(_attribute(key, value) for key, value in attributes.items())}>"
    return Markup(start) if tag in _VOID else Markup(f"{start}{joined(content)}</{tag}>")


def joined(parts: Iterable[str]) -> Markup:
    """All parts one after the other; text among them is escaped."""
    return Markup(
        "".join(part if isinstance(part, Markup) else escape(harmless_lines(part), quote=False) for part in parts)
    )


def name_of(text: str) -> Markup:
    """A name inside a sentence, whose writing direction does not touch its neighbours."""
    return element("bdi", text)


def _attribute(key: str, value: Attribute) -> str:
    if value is None or value is False:
        return ""
    name = key.rstrip("_").replace("_", "-")
    if value is True:
        return f" {name}"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f' {name}="{escape(harmless_lines(text))}"'


STUBS = ("Dataset", "Task")
"""Headings of the two columns that say what a row is about."""

_WIDEST_PAD, _WIDEST_SLOT, _WIDEST_TRAIL = 4, 7, 11


def html(table: Table) -> str:
    """A ``<figure>`` with its own style, the table and the notes; it asks for no script, font or file.

    Highlighted numbers are bold on a tinted ground; colours are those of the page around it.
    """
    return (
        element(
            "figure",
            element("style", Markup(table_style())),
            element("div", score_table(table), class_="scroll"),
            element("figcaption", notes_list(table.notes)),
            class_="lfobench-table",
        )
        + "\n"
    )


@cache
def table_style() -> str:
    """The style sheet of the table and its notes."""
    return files(__package__).joinpath("html_table.css").read_text(encoding="utf-8")


def score_table(table: Table, **attributes: str) -> Markup:
    """The ``<table>``. A row knows its number as ``data-row``, a cell its column's as ``data-column``."""
    return element("table", _head(table), _body(table), **attributes)


def notes_list(notes: tuple[Note, ...], kinds: tuple[str, ...] = ()) -> Markup:
    """The notes as a list of definitions; `kinds`, one per note, become ``data-kind``."""
    chosen = kinds or ("",) * len(notes)
    return element(
        "dl",
        *(
            element("div", element("dt", note.label), " ", element("dd", note.text), data_kind=kind or None)
            for note, kind in zip(notes, chosen, strict=True)
        ),
        class_="notes",
    )


def _head(table: Table) -> Markup:
    groups = [
        element(
            "th",
            element("span", group.label),
            scope="colgroup",
            class_="group",
            colspan=str(group.stop - group.start),
        )
        for group in column_groups(table.columns)
    ]
    stubs = [element("th", name, scope="col", class_="stub", data_sort="text") for name in STUBS]
    names = [
        element("th", column.label, scope="col", data_sort="number", data_column=str(index))
        for index, column in enumerate(table.columns)
    ]
    blank = element("td", colspan=str(len(STUBS)))
    return element("thead", element("tr", blank, *groups), element("tr", *stubs, *names))


def _body(table: Table) -> Markup:
    columns = [_Column(table, index) for index in range(len(table.columns))]
    rows, position = [], 0
    for block in table.blocks:
        for index, row in enumerate(block.rows):
            rows.append(
                element(
                    "tr",
                    element("th", block.label, scope="row", class_="stub block" + (" same" if index else "")),
                    element("th", row.label, scope="row", class_="stub task", title=row.task),
                    *(column.cell(cell) for column, cell in zip(columns, row.cells, strict=True)),
                    class_=None if index else "first",
                    data_row=str(position),
                )
            )
            position += 1
    return element("tbody", *rows)


class _Column:
    """One column's cells, aligned at the decimal points by padding what has fewer digits than the widest.

    Intervals behind counts all take the room of the widest that there can be.
    """

    def __init__(self, table: Table, index: int) -> None:
        self.index = index
        self.run_here = table.columns[index].run_here
        texts = [cell_text(cell) for _, row in table.rows() if (cell := row.cells[index]) is not None]
        self.spread = max((len(text.std) for text in texts), default=0)
        self.interval = any(text.interval for text in texts)
        # Bold digits are wider: a slot of fixed width behind the mean keeps the means in line.
        self.slot = f"spread slot-{min(self.spread, _WIDEST_SLOT)}"
        self.trail = min(1 + max((len(text.marks) for text in texts), default=0), _WIDEST_TRAIL)

    def cell(self, cell: Cell | None) -> Markup:
        kind = "" if self.run_here else "other"
        if cell is None:
            return element("td", MISSING, self._trail(None), class_=kind or None, data_column=str(self.index))
        text = cell_text(cell)
        return element(
            "td",
            element("span", text.mean, class_="mean"),
            self._spread(text),
            self._trail(text),
            element("span", " (highlighted)", class_="spoken") if self.run_here else "",
            class_=" ".join(filter(None, [kind, "highlighted" if cell.highlighted else ""])) or None,
            data_column=str(self.index),
            data_value=_value(cell),
        )

    def _spread(self, text: CellText) -> Markup:
        if self.interval:
            return element("span", f" {text.interval}", class_="spread interval")
        if not self.spread:
            return Markup("")
        if not text.std:
            # Keeps the mean in line with those above and below.
            return element(
                "span", f" {PLUS_MINUS} ", "0" * (self.spread - 1), class_=self.slot + " hollow", aria_hidden="true"
            )
        missing = min(self.spread - len(text.std), _WIDEST_PAD)
        return element(
            "span",
            f" {PLUS_MINUS} ",
            element("span", text.std, class_=f"pad-{missing}" if missing else None),
            class_=self.slot,
        )

    def _trail(self, text: CellText | None) -> Markup:
        dagger = element("span", text.lost if text else "", class_="dagger") if self.run_here else Markup("")
        signs = [element("span", mark, class_=kind, title=meaning) for mark, kind, meaning in _signs(text)]
        return element("span", dagger, *signs, class_=f"trail trail-{self.trail}")


def _value(cell: Cell) -> str | None:
    """What a column is sorted by: the mean score, or the success rate in per cent."""
    if cell.successes is not None:
        return repr(100.0 * cell.successes.pooled.rate)
    return repr(cell.summary.mean) if cell.summary else None


def _signs(text: CellText | None) -> Iterator[tuple[str, str, str]]:
    """(mark, class, meaning) of what stands behind a number."""
    if text is None:
        return
    for mark, count, what in ((DIVERGED, text.diverged, "diverged"), (FAILED, text.failed, "failed")):
        if count:
            yield f"{mark}{count}", "marks", f"{count} {'seed' if count == '1' else 'seeds'} {what}"
    for agreement, sign in AGREEMENTS.items():
        if sign == text.agreement:
            yield text.verdict, "agreement", agreement
