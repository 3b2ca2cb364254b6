"""The table in HTML: a fragment to paste into a page, and the parts that the report is built around."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from jinja2 import BaseLoader, ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from lfobench.tables.table import (
    DIVERGED,
    FAILED,
    MISSING,
    PLUS_MINUS,
    Cell,
    CellText,
    Table,
    cell_text,
    column_groups,
)
from lfobench.text import counted, harmless_lines

_WIDEST_PAD, _WIDEST_SLOT, _WIDEST_TRAIL = 4, 7, 11


def export(table: Table) -> str:
    """A ``<figure>`` with its own style, the table and the notes; it asks for no script, font or file.

    Highlighted numbers are bold on a tinted ground; colours are those of the page around it.
    """
    fragment = templates().get_template("fragment.html")
    return fragment.render(table_context(table), style=Markup(table_style())) + "\n"


def templates(*others: BaseLoader) -> Environment:
    """The templates of this package, and others. Whatever is put into them is text, and comes out as text."""
    return Environment(
        loader=ChoiceLoader([PackageLoader(__package__), *others]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_harmless,
    )


def _harmless(value: object) -> object:
    """Control codes and marks of the writing direction spelt out; nothing for None."""
    if isinstance(value, Markup):
        return value
    return "" if value is None else harmless_lines(str(value))


def table_context(table: Table) -> dict[str, Any]:
    """Names that ``table.html`` uses."""
    return {
        "table": table,
        "groups": column_groups(table.columns),
        "widths": [_widths(table, index) for index in range(len(table.columns))],
        "cell_text": cell_text,
        "sort_value": _sort_value,
        "counted": counted,
        "plus_minus": PLUS_MINUS,
        "missing": MISSING,
        "diverged": DIVERGED,
        "failed": FAILED,
    }


def table_style() -> str:
    """The style sheet of the table and its notes."""
    return template_file(__package__, "table.css")


def template_file(package: str, name: str) -> str:
    """A file among the templates of a package."""
    return files(package).joinpath("templates", name).read_text(encoding="utf-8")


@dataclass(frozen=True)
class _Widths:
    """Space that the cells of one column share, so that numbers align at the decimal points.

    Attributes:
        spread: characters of the longest standard deviation.
        interval: whether an interval follows the numbers.
        trail: characters of the longest marks, and of a dagger.
    """

    spread: int
    interval: bool
    trail: int

    @property
    def slot(self) -> str:
        """Class of the spread. Bold digits are wider: a slot of fixed width keeps the means in line."""
        return f"spread slot-{min(self.spread, _WIDEST_SLOT)}"

    def pad(self, text: CellText) -> str | None:
        """Class of a standard deviation that is shorter than the longest."""
        short = min(self.spread - len(text.std), _WIDEST_PAD)
        return f"pad-{short}" if short else None


def _widths(table: Table, index: int) -> _Widths:
    texts = [cell_text(cell) for _, row in table.rows() if (cell := row.cells[index]) is not None]
    return _Widths(
        spread=max((len(text.std) for text in texts), default=0),
        interval=any(text.interval for text in texts),
        trail=min(1 + max((len(text.marks) for text in texts), default=0), _WIDEST_TRAIL),
    )


def _sort_value(cell: Cell | None) -> str | None:
    """The mean score, or the success rate in per cent."""
    if cell is None or cell.summary is None:
        return None
    return repr(100.0 * cell.successes.pooled.rate if cell.successes else cell.summary.mean)
