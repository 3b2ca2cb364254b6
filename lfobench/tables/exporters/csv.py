"""The table as CSV in long format: one line per cell, numbers unrounded, nothing left to a footnote."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping

from lfobench.tables.table import Block, Cell, Column, Row, Table
from lfobench.text import harmless


def export(table: Table) -> str:
    """CSV with a header.

    A cell without records has n = 0; `mean`, `std`, `p` and `adjusted_p` are empty where undefined; flags are 0 or
    1; seeds and their scores are separated by blanks. `outcome`, `p` and `adjusted_p` belong to the row: best against
    second best in scope. A table of success counts has more columns: counts are pooled over seeds; `fixed_` ones are
    those of the fixed test starts alone, `seed_` ones those of every seed, in the order of `seeds`; the ends of the
    rate's interval lie between 0 and 1.
    """
    return csv_text(
        _line(table, block, row, column, cell or Cell(sample=None))
        for block, row in table.rows()
        for column, cell in zip(table.columns, row.cells, strict=True)
    )


def _line(table: Table, block: Block, row: Row, column: Column, cell: Cell) -> dict[str, object]:
    summary, rule = cell.summary, table.rule
    line: dict[str, object] = {
        "group": block.label,
        "row": row.label,
        "task": row.task,
        "column": column.label,
        "method": column.method,
        "preset": column.preset,
        "column_group": column.kind,
        "n": summary.n if summary else 0,
        "mean": summary and summary.mean,
        "std": summary and summary.std,
        "highlighted": int(cell.highlighted),
        "lost_under_correction": int(cell.lost),
        "outcome": row.outcome,
        "p": row.p,
        "adjusted_p": row.adjusted_p,
        "scores": cell.sample.seeds if cell.sample else (),
        "seeds": cell.seeds,
        "diverged_seeds": cell.diverged_seeds,
        "failed_seeds": cell.failed_seeds,
        "agreement": cell.agreement,
        "statistic": table.statistic,
        "test": rule.test,
        "scope": rule.scope,
        "correction": rule.correction,
        "alpha": rule.alpha,
        "source": table.source,
        "protocol": table.protocol,
    }
    if table.counts:
        found = cell.successes
        line |= {
            "successes": found and found.pooled.successes,
            "trials": found and found.pooled.trials,
            "rate_low": found and found.interval.low,
            "rate_high": found and found.interval.high,
            "fixed_successes": found and found.fixed.successes,
            "fixed_trials": found and found.fixed.trials,
            "variance_inflation": found and found.inflation,
            "seed_successes": found and [count.successes for count in found.seeds],
            "seed_trials": found and [count.trials for count in found.seeds],
            "agreement_p": cell.agreement_p,
        }
    return line


def csv_text(lines: Iterable[Mapping[str, object]]) -> str:
    """Lines of named fields, all of the same names, as CSV with a header.

    Text is on one line and without control codes; sequences are separated by blanks. Where a spreadsheet would take a
    name for a formula, the name has an apostrophe before it.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for index, line in enumerate(lines):
        if index == 0:
            writer.writerow(line)
        writer.writerow(map(_field, line.values()))
    return text.getvalue()


_FORMULA = frozenset("=+-@")
_NUMBERS = re.compile(r"-?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?( -?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?)*")
"""Scores by seed, which may begin with a minus."""


def _field(value: object) -> object:
    if value is None or isinstance(value, int | float):
        return value
    text = harmless(" ".join(map(str, value)) if isinstance(value, tuple | list) else str(value))
    return f"'{text}" if text[:1] in _FORMULA and not _NUMBERS.fullmatch(text) else text
