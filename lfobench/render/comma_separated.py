"""The table as CSV in long format: one line per cell, numbers unrounded, nothing left to a footnote."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable

from lfobench.render.table import Table

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


def comma_separated(table: Table) -> str:
    """CSV with a header of `FIELDS`.

    A cell without records has n = 0; `mean`, `std`, `p` and `adjusted_p` are empty where undefined; flags are 0 or
    1; seeds and their scores are separated by blanks. `outcome`, `p` and `adjusted_p` belong to the row: best against
    second best in scope.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(FIELDS)
    for block, row in table.rows():
        for column, cell in zip(table.columns, row.cells, strict=True):
            summary = cell.summary if cell else None
            writer.writerow(
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
                ]
            )
    return text.getvalue()


def _joined(values: Iterable[float]) -> str:
    return " ".join(map(str, values))
