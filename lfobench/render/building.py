"""Records in, table out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lfobench.contract.record import Record, Statistic
from lfobench.errors import UserError
from lfobench.render.columns import arrange_columns
from lfobench.render.conditions import check_cell, check_unmixed
from lfobench.render.footnote import footnote
from lfobench.render.table import Block, Cell, Column, Row, Table
from lfobench.stats.highlight import highlight
from lfobench.stats.summary import summarize


def build_table(
    records: Sequence[Record],
    statistic: Statistic = "last5",
    alpha: float = 0.05,
    tasks: Sequence[str] = (),
    methods: Sequence[str] = (),
) -> Table:
    """The table of `records`, one row per task and one column per method, with its generated footnote.

    Args:
        records: from one source under one protocol, in any order.
        statistic: what a run's evaluations are reduced to.
        alpha: significance level of the highlight rule.
        tasks: names in row order; tasks not named follow as they first appear.
        methods: names in column order, inside each column group; the others follow as they first appear.

    Raises:
        UserError: there are no records, or they must not share a table (see `conditions`).
    """
    if not records:
        raise UserError("There are no records to make a table of.", "Run `lfobench run` first.")
    check_unmixed(records)
    columns = arrange_columns(records, methods)
    rows = _rows(columns, _in_order([record.task for record in records], tasks), statistic, alpha)
    blocks = _blocks(rows, {record.task: record for record in records})
    table = Table(
        columns=tuple(columns),
        blocks=blocks,
        notes=(),
        statistic=statistic,
        source=str(records[0].identity["source"]),
        protocol=str(records[0].identity["protocol"]["name"]),
    )
    return replace(table, notes=footnote(table, columns, alpha))


def _in_order(names: Sequence[str], order: Sequence[str]) -> list[str]:
    ranks = {name: rank for rank, name in enumerate(order)}
    return sorted(dict.fromkeys(names), key=lambda name: ranks.get(name, len(ranks)))


def _rows(columns: dict[Column, list[Record]], tasks: Sequence[str], statistic: Statistic, alpha: float) -> list[Row]:
    rows = []
    for task in tasks:
        cells = {
            column: _cell(members, statistic)
            for column, records in columns.items()
            if (members := [record for record in records if record.task == task])
        }
        outcome = highlight(
            {column: cell.summary for column, cell in cells.items() if not column.sees_expert_actions}, alpha
        )
        for column in outcome.methods:
            cells[column] = replace(cells[column], highlighted=True)
        row = tuple(cells.get(column) for column in columns)
        rows.append(Row(task, task, row, outcome.verdict, outcome.p))
    return rows


def _cell(records: Sequence[Record], statistic: Statistic) -> Cell:
    check_cell(records)
    by_seed = sorted(records, key=lambda record: record.seed)
    return Cell(
        summary=summarize([record.score(statistic) for record in by_seed]),
        seeds=tuple(record.seed for record in by_seed),
        diverged_seeds=tuple(record.seed for record in by_seed if record.status == "diverged"),
        highlighted=False,
    )


def _blocks(rows: Sequence[Row], example: dict[str, Record]) -> tuple[Block, ...]:
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(example[row.task].labels.group, []).append(row)
    return tuple(
        Block(
            group,
            # Two suites may use one short name in one group; the task's full name tells them apart.
            tuple(
                row if shorts.count(short) > 1 else replace(row, label=short)
                for row, short in zip(members, shorts, strict=True)
            ),
        )
        for group, members in groups.items()
        if (shorts := [example[row.task].labels.row for row in members])
    )
