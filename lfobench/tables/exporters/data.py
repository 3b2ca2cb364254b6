"""The table as CSV in long format: one line per cell, numbers unrounded, nothing left to a footnote."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Sequence
from typing import Any

from lfobench.stats.successes import Count
from lfobench.tables.table import Cell, Column, Row, Table, column_groups
from lfobench.text import harmless

FIELDS = (
    "group",
    "row",
    "task",
    "column",
    "method",
    "preset",
    "column_group",
    "n",
    "mean",
    "std",
    "highlighted",
    "lost_under_correction",
    "outcome",
    "p",
    "adjusted_p",
    "scores",
    "seeds",
    "diverged_seeds",
    "failed_seeds",
    "agreement",
    "statistic",
    "test",
    "scope",
    "correction",
    "alpha",
    "source",
    "protocol",
)

COUNT_FIELDS = (
    "successes",
    "trials",
    "rate_low",
    "rate_high",
    "fixed_successes",
    "fixed_trials",
    "variance_inflation",
    "seed_successes",
    "seed_trials",
    "agreement_p",
)
"""Behind `FIELDS` in a table of success counts."""


def comma_separated(table: Table) -> str:
    """CSV with a header of `FIELDS`; a table of success counts has `COUNT_FIELDS` too.

    A cell without records has n = 0; `mean`, `std`, `p` and `adjusted_p` are empty where undefined; flags are 0 or
    1; seeds and their scores are separated by blanks. `outcome`, `p` and `adjusted_p` belong to the row: best against
    second best in scope. Counts are pooled over seeds; `fixed_` ones are those of the fixed test starts alone, `seed_`
    ones those of every seed, in the order of `seeds`; the ends of the rate's interval lie between 0 and 1.
    """
    lines: list[Sequence[object]] = [[*FIELDS, *(COUNT_FIELDS if table.counts else ())]]
    for block, row in table.rows():
        for column, cell in zip(table.columns, row.cells, strict=True):
            summary = cell.summary if cell else None
            lines.append(
                [
                    block.label,
                    row.label,
                    row.task,
                    column.label,
                    column.method,
                    column.preset,
                    column.kind,
                    summary.n if summary else 0,
                    summary.mean if summary else None,
                    summary.std if summary else None,
                    int(cell.highlighted) if cell else 0,
                    int(cell.lost) if cell else 0,
                    row.outcome,
                    row.p,
                    row.adjusted_p,
                    _joined(cell.sample.seeds if cell and cell.sample else ()),
                    _joined(cell.seeds if cell else ()),
                    _joined(cell.diverged_seeds if cell else ()),
                    _joined(cell.failed_seeds if cell else ()),
                    (cell.agreement or "") if cell else "",
                    table.statistic,
                    table.rule.test,
                    table.rule.scope,
                    table.rule.correction,
                    table.rule.alpha,
                    table.source,
                    table.protocol,
                    *(_counts(cell) if table.counts else ()),
                ]
            )
    return csv_text(lines)


def csv_text(lines: Iterable[Sequence[object]]) -> str:
    """Lines of fields as CSV.

    Text is on one line and without control codes. Where a spreadsheet would take a name for a formula, the name has an
    apostrophe before it.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_field(value) for value in line] for line in lines)
    return text.getvalue()


def _field(value: object) -> object:
    if value is None or isinstance(value, int | float):
        return value
    text = harmless(str(value))
    return f"'{text}" if text[:1] in _FORMULA and not _NUMBERS.fullmatch(text) else text


_FORMULA = frozenset("=+-@")
_NUMBERS = re.compile(r"-?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?( -?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?)*")
"""What scores by seed look like, which may begin with a minus."""


def _counts(cell: Cell | None) -> list[float | str | None]:
    """The values of `COUNT_FIELDS`."""
    if cell is None or cell.successes is None:
        return [None] * len(COUNT_FIELDS)
    found = cell.successes
    return [
        found.pooled.successes,
        found.pooled.trials,
        found.interval.low,
        found.interval.high,
        found.fixed.successes,
        found.fixed.trials,
        found.inflation,
        _joined(count.successes for count in found.seeds),
        _joined(count.trials for count in found.seeds),
        cell.agreement_p,
    ]


def _joined(values: Iterable[float]) -> str:
    return " ".join(map(str, values))


def json_table(table: Table) -> str:
    """One object: the rule, the columns with their groups, the rows with their cells, the notes.

    A cell without records is null; numbers are unrounded; `scores` are per seed, in the order of `seeds`.
    A table of success counts has `successes` in every cell: from the fixed test starts, from all starts, by seed, the
    interval of the rate between 0 and 1, and its variance inflation by seeds.
    """
    groups = {
        column: group.label
        for group in column_groups(table.columns)
        for column in table.columns[group.start : group.stop]
    }
    value = {
        "statistic": str(table.statistic),
        "source": table.source,
        "protocol": table.protocol,
        "rule": {
            "test": table.rule.test,
            "scope": table.rule.scope,
            "correction": table.rule.correction,
            "alpha": table.rule.alpha,
        },
        "columns": [_column(column, groups[column]) for column in table.columns],
        "rows": [_row(block.label, row, table.counts) for block, row in table.rows()],
        "notes": [{"label": note.label, "text": note.text} for note in table.notes],
    }
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def _column(column: Column, group: str) -> dict[str, Any]:
    return {"label": column.label, "method": column.method, "preset": column.preset, "group": group}


def _row(group: str, row: Row, counts: bool) -> dict[str, Any]:
    return {
        "group": group,
        "row": row.label,
        "task": row.task,
        "outcome": row.outcome,
        "p": row.p,
        "adjusted_p": row.adjusted_p,
        "cells": [_cell(cell) | (_counts_as_json(cell) if counts else {}) if cell else None for cell in row.cells],
    }


def _cell(cell: Cell) -> dict[str, Any]:
    summary = cell.summary
    return {
        "n": summary.n if summary else 0,
        "mean": summary.mean if summary else None,
        "std": summary.std if summary else None,
        "scores": list(cell.sample.seeds) if cell.sample else [],
        "seeds": list(cell.seeds),
        "diverged_seeds": list(cell.diverged_seeds),
        "failed_seeds": list(cell.failed_seeds),
        "highlighted": cell.highlighted,
        "lost_under_correction": cell.lost,
        "agreement": cell.agreement,
    }


def _counts_as_json(cell: Cell) -> dict[str, Any]:
    found = cell.successes
    if found is None:
        return {"successes": None, "agreement_p": cell.agreement_p}
    return {
        "successes": {
            "fixed": _count(found.fixed),
            "all": _count(found.pooled),
            "interval": [found.interval.low, found.interval.high],
            "variance_inflation": found.inflation,
            "seeds": [_count(count) for count in found.seeds],
        },
        "agreement_p": cell.agreement_p,
    }


def _count(count: Count) -> dict[str, int]:
    return {"successes": count.successes, "trials": count.trials}
