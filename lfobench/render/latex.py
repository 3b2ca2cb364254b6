r"""The table in LaTeX, after the seed paper's Table 1: booktabs rules, column groups, a macro.

The output compiles as it is in a document that loads ``booktabs`` and ``xcolor``. Define ``\lfobenchbest``
before the table to highlight differently.
"""

from __future__ import annotations

import re

from lfobench.render.cell_text import MISSING, cell_text
from lfobench.render.table import Cell, Table, column_groups
from lfobench.stats.names import Agreement

_PREAMBLE = r"""% Needs \usepackage{booktabs} and \usepackage{xcolor}.
\providecommand{\lfobenchbest}[1]{\textcolor{blue}{\boldmath#1}}
"""

_THIN_SPACE = r"\,"
_AGREEMENTS: dict[Agreement, str] = {"matches": r"\approx", "differs": r"\neq", "undecided": "?"}

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
}


def latex(table: Table) -> str:
    """A ``table`` environment with the notes below the rows."""
    groups = column_groups(table.columns)
    alignment = "".join("r" * (group.stop - group.start) for group in groups)
    # The first column holds the task; TeX counts columns from 1.
    spans = [rf"\multicolumn{{{group.stop - group.start}}}{{c}}{{{escape(group.label)}}}" for group in groups]
    rules = [rf"\cmidrule(lr){{{group.start + 2}-{group.stop + 1}}}" for group in groups]
    lines = [
        r"\begin{table}[t]",
        r"\centering\footnotesize\setlength{\tabcolsep}{3pt}",
        rf"\begin{{tabular}}{{l{alignment}}}",
        r"\toprule",
        _line(["", *spans]),
        " ".join(rules),
        _line(["Task", *(escape(column.label) for column in table.columns)]),
    ]
    std_digits = [_std_digits(table, index) for index in range(len(table.columns))]
    for block in table.blocks:
        # A heading above its rows, not a column beside them: six methods then fit the width of a page.
        lines += [r"\midrule", rf"\multicolumn{{{len(table.columns) + 1}}}{{l}}{{{escape(block.label)}}} \\"]
        for row in block.rows:
            cells = [_cell(cell, digits) for cell, digits in zip(row.cells, std_digits, strict=True)]
            lines.append(_line([rf"\quad {escape(row.label)}", *cells]))
    lines += [r"\bottomrule", r"\end{tabular}", "", r"\medskip", r"\begin{minipage}{\linewidth}\footnotesize"]
    lines += [rf"\textbf{{{escape(note.label)}:}} {escape(note.text)}\par" for note in table.notes]
    lines += [r"\end{minipage}", r"\end{table}"]
    return _PREAMBLE + "\n".join(lines) + "\n"


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


def _std_digits(table: Table, column: int) -> int:
    cells = [row.cells[column] for _, row in table.rows()]
    return max((len(cell_text(cell).std) for cell in cells if cell), default=0)


def _cell(cell: Cell | None, std_digits: int) -> str:
    """One cell; phantoms and a mark of no width keep right-aligned numbers aligned at the decimal point."""
    if cell is None:
        return escape(MISSING)
    text = cell_text(cell)
    missing_digits = "0" * (std_digits - len(text.std))
    padding = rf"\phantom{{{missing_digits}}}" if missing_digits else ""
    spread = rf" \pm {padding}{text.std}" if text.std else ""
    number = f"${text.mean}{spread}$"
    if cell.summary is None:
        number = escape(MISSING)
    if cell.highlighted:
        number = rf"\lfobenchbest{{{number}}}"
    marks = [r"\dagger"] if text.lost else []
    marks += [rf"\times{text.diverged}"] if text.diverged else []
    marks += [f"!{text.failed}"] if text.failed else []
    marks += [_AGREEMENTS[cell.agreement]] if cell.agreement else []
    return number + (rf"\rlap{{$^{{{_THIN_SPACE.join(marks)}}}$}}" if marks else "")
