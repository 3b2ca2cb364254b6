"""The table as one JSON object: the rule, the columns with their groups, the rows with their cells, the notes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from lfobench.stats.intervals import Interval
from lfobench.stats.successes import Successes
from lfobench.tables.table import Cell, Note, Table, column_groups


def export(table: Table) -> str:
    """A cell without records is null; numbers are unrounded; `scores` are per seed, in the order of `seeds`.

    A table of success counts has `successes` in every cell: from the fixed test starts, from all starts, by seed, the
    interval of the rate between 0 and 1, and its variance inflation by seeds.
    """
    rule = table.rule
    value = {
        "statistic": str(table.statistic),
        "source": table.source,
        "protocol": table.protocol,
        "rule": {"test": rule.test, "scope": rule.scope, "correction": rule.correction, "alpha": rule.alpha},
        "columns": [
            {"label": column.label, "method": column.method, "preset": column.preset, "group": group.label}
            for group in column_groups(table.columns)
            for column in table.columns[group.start : group.stop]
        ],
        "rows": [
            {
                "group": block.label,
                "row": row.label,
                "task": row.task,
                "outcome": row.outcome,
                "p": row.p,
                "adjusted_p": row.adjusted_p,
                "cells": [cell and _cell(cell, table.counts) for cell in row.cells],
            }
            for block, row in table.rows()
        ],
        "notes": notes_value(table.notes),
    }
    return json_text(value)


def _cell(cell: Cell, counts: bool) -> dict[str, Any]:
    summary = cell.summary
    value: dict[str, Any] = {
        "n": summary.n if summary else 0,
        "mean": summary and summary.mean,
        "std": summary and summary.std,
        "scores": cell.sample.seeds if cell.sample else (),
        "seeds": cell.seeds,
        "diverged_seeds": cell.diverged_seeds,
        "failed_seeds": cell.failed_seeds,
        "highlighted": cell.highlighted,
        "lost_under_correction": cell.lost,
        "agreement": cell.agreement,
    }
    if counts:
        value |= {"successes": cell.successes and _successes(cell.successes), "agreement_p": cell.agreement_p}
    return value


def _successes(found: Successes) -> dict[str, Any]:
    return {
        "fixed": asdict(found.fixed),
        "all": asdict(found.pooled),
        "interval": [found.interval.low, found.interval.high],
        "variance_inflation": found.inflation,
        "seeds": [asdict(count) for count in found.seeds],
    }


def json_text(value: Any) -> str:
    """A value as indented JSON; not a number is an error."""
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def notes_value(notes: Sequence[Note]) -> list[dict[str, str]]:
    """Notes as objects."""
    return [asdict(note) for note in notes]


def interval_value(interval: Interval | None) -> dict[str, float] | None:
    """An interval as an object; null for none."""
    return asdict(interval) if interval else None
