r"""The table in LaTeX, after the seed paper's Table 1: booktabs rules, column groups, a macro.

The output compiles as it is in a document that loads ``booktabs`` and ``xcolor``. Define ``\lfobenchbest``
before the table to highlight differently, ``\lfobenchinterval`` for other intervals behind success counts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lfobench.stats.options import Agreement
from lfobench.tables.table import CRASHED, MISSING, Cell, CellText, Note, Table, cell_text, column_groups

_PREAMBLE = r"""% Needs \usepackage{booktabs} and \usepackage{xcolor}.
\providecommand{\lfobenchbest}[1]{\textcolor{blue}{\boldmath#1}}
"""

_INTERVAL = r"""\providecommand{\lfobenchinterval}[2]{\,\mbox{\tiny[#1,\,#2]}}
"""

# The text of a page is 345 pt wide in the standard classes: six methods and the demonstration need the small one.
_FEW_COLUMNS = 5
_FEW = r"\footnotesize\setlength{\tabcolsep}{3pt}"
_MANY = r"\scriptsize\setlength{\tabcolsep}{2pt}"

_THIN_SPACE = r"\,"
_AGREEMENTS: dict[Agreement, str] = {
    "matches": r"\approx",
    "differs": r"\neq",
    "undecided": "?",
    "not told apart": r"\sim",
}

_ESCAPES = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"{\char34}",
    "`": r"{`}",
    "±": r"$\pm$",
    "·": r"$\cdot$",
    "−": r"$-$",
    "–": r"\textendash{}",
    "✗": r"$\times$",
    "†": r"$\dagger$",
    "≈": r"$\approx$",
    "≠": r"$\neq$",
    "∼": r"$\sim$",
}


def export(table: Table) -> str:
    """A ``table`` environment with the notes below the rows."""
    groups = column_groups(table.columns)
    alignment = "".join("r" * (group.stop - group.start) for group in groups)
    # The first column holds the task; TeX counts columns from 1.
    spans = [rf"\multicolumn{{{group.stop - group.start}}}{{c}}{{{escape(group.label)}}}" for group in groups]
    rules = [rf"\cmidrule(lr){{{group.start + 2}-{group.stop + 1}}}" for group in groups]
    lines = [
        r"\begin{table}[t]",
        rf"\centering{_MANY if len(table.columns) > _FEW_COLUMNS else _FEW}",
        rf"\begin{{tabular}}{{@{{}}l{alignment}@{{}}}}",
        r"\toprule",
        _line(["", *spans]),
        " ".join(rules),
        # The demonstration's group has no other column, and its name is as wide as three numbers.
        _line(["Task", *("" if column.kind == "expert" else escape(column.label) for column in table.columns)]),
    ]
    slots = [_slots(table, index) for index in range(len(table.columns))]
    for block in table.blocks:
        # A heading above its rows, not a column of its own: six methods then fit the width of a page.
        lines += [r"\midrule", rf"\multicolumn{{{len(table.columns) + 1}}}{{@{{}}l}}{{{escape(block.label)}}} \\"]
        for row in block.rows:
            cells = [_cell(cell, slot) for cell, slot in zip(row.cells, slots, strict=True)]
            lines.append(_line([rf"\quad {escape(row.label)}", *cells]))
    lines += ending(table.notes)
    return _PREAMBLE + (_INTERVAL if table.counts else "") + "\n".join(lines) + "\n"


def ending(notes: Sequence[Note]) -> Iterator[str]:
    """The last rule of a table, and the notes below it."""
    yield from (r"\bottomrule", r"\end{tabular}", "", r"\medskip", r"\begin{minipage}{\linewidth}\footnotesize")
    yield from (rf"\textbf{{{escape(note.label)}:}} {escape(note.text)}\par" for note in notes)
    yield from (r"\end{minipage}", r"\end{table}")


def escape(text: str) -> str:
    """Text that TeX typesets as it is written; a character that its default fonts lack becomes ``U+XXXX``."""
    escaped = "".join(_escape_character(character) for character in " ".join(text.split()))
    # Two hyphens in a row would become a dash, two apostrophes or commas a quotation mark.
    return re.sub(r"([-',])(?=\1)", r"\1{}", escaped)


def _escape_character(character: str) -> str:
    if character in _ESCAPES:
        return _ESCAPES[character]
    return character if " " <= character <= "~" else f"U+{ord(character):04X}"


def _line(fields: list[str]) -> str:
    return rf"{' & '.join(fields)} \\"


@dataclass(frozen=True)
class _Slots:
    """Widths that the cells of one column share, so that right-aligned numbers align at the decimal point."""

    std_digits: int
    interval_digits: int
    marks: str


def _slots(table: Table, column: int) -> _Slots:
    cells = [cell for _, row in table.rows() if (cell := row.cells[column])]
    texts = [cell_text(cell) for cell in cells]
    std_digits = max((len(text.std) for text in texts), default=0)
    interval_digits = max((len(end) for text in texts for end in (text.low, text.high)), default=0)
    return _Slots(std_digits, interval_digits, max((_marks(cell) for cell in cells), key=_printed, default=""))


def _cell(cell: Cell | None, slots: _Slots) -> str:
    """One cell; phantoms are as wide as what other cells of its column have and this one lacks."""
    text = cell_text(cell) if cell else CellText(MISSING)
    spread = _spread(text.std, slots.std_digits) + _interval(text, slots.interval_digits)
    marks = _marks(cell) if cell else ""
    # Marks of no width are followed by a phantom of the widest ones.
    trail = marks if marks == slots.marks else rf"\rlap{{{marks}}}" * bool(marks) + _phantom(slots.marks)
    if text.mean in (MISSING, CRASHED):
        # A dash is no minus sign, a word no product; neither is followed by the space of an operator.
        return escape(text.mean) + trail + (f"${spread}$" if spread else "")
    number = f"${_number(text.mean)}{spread}$"
    return (rf"\lfobenchbest{{{number}}}" if cell and cell.highlighted else number) + trail


def _spread(std: str, digits: int) -> str:
    if std:
        return rf" \pm {_phantom('0' * (digits - len(std)))}{_number(std)}"
    return _phantom(rf"{{}} \pm {'0' * (digits - 2)}.0") if digits else ""


def _number(text: str) -> str:
    """A number inside mathematics, where a letter would be a variable: ``1.2e12``."""
    return text.replace("e", r"\mathrm{e}")


def _interval(text: CellText, digits: int) -> str:
    """Both ends of one width, so that the counts before them align."""
    if not text.low:
        return _phantom(rf"\lfobenchinterval{{{'0' * digits}}}{{}}") if digits else ""
    low, high = (f"{_phantom('0' * (digits - len(end)))}{end}" for end in (text.low, text.high))
    return rf"\lfobenchinterval{{{low}}}{{{high}}}"


def _phantom(text: str) -> str:
    """Blank space as wide as `text`."""
    return rf"\phantom{{{text}}}" if text else ""


def _marks(cell: Cell) -> str:
    """The superscript behind a number."""
    text = cell_text(cell)
    marks = [r"\dagger"] if text.lost else []
    marks += [rf"\times{text.diverged}"] if text.diverged else []
    marks += [f"!{text.failed}"] if text.failed else []
    marks += [_AGREEMENTS[cell.agreement]] if cell.agreement else []
    marks += [rf"p\,{text.p}"] if text.p else []
    return f"$^{{{_THIN_SPACE.join(marks)}}}$" if marks else ""


def _printed(marks: str) -> int:
    """About how many characters are printed: a command is one of them."""
    return len(re.sub(r"\\[a-z]+", "x", marks))
