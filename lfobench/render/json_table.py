"""The table as JSON: everything that it shows and every score behind it."""

from __future__ import annotations

import json
from typing import Any

from lfobench.render.table import Cell, Column, Row, Table, column_groups
from lfobench.stats.successes import Count


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
        "cells": [_cell(cell) | (_counts(cell) if counts else {}) if cell else None for cell in row.cells],
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


def _counts(cell: Cell) -> dict[str, Any]:
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
