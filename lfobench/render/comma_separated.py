"""The table as CSV in long format: one line per cell, numbers unrounded, nothing left to a footnote."""

from __future__ import annotations

import csv
import io

from lfobench.render.table import Table

FIELDS = (
    "group",
    "row",
    "task",
    "column",
    "method",
    "preset",
    "sees_expert_actions",
    "n",
    "mean",
    "std",
    "highlighted",
    "p",
    "seeds",
    "diverged_seeds",
    "statistic",
    "source",
    "protocol",
)


def comma_separated(table: Table) -> str:
    """CSV with a header of `FIELDS`.

    A cell without records has n = 0; `mean`, `std` and `p` are empty where undefined; flags are 0 or 1; seeds
    are separated by blanks. `p` belongs to the row: best against second best of the methods without expert
    actions.
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
                    int(column.sees_expert_actions),
                    summary.n if summary else 0,
                    summary.mean if summary else None,
                    summary.std if summary else None,
                    int(cell.highlighted) if cell else 0,
                    row.p,
                    " ".join(map(str, cell.seeds)) if cell else "",
                    " ".join(map(str, cell.diverged_seeds)) if cell else "",
                    table.statistic,
                    table.source,
                    table.protocol,
                ]
            )
    return text.getvalue()
