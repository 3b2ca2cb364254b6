"""Records in, table out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from lfobench.contract.failure import Failure
from lfobench.contract.record import Record, usable
from lfobench.contract.statistic import HEADLINE, Statistic
from lfobench.errors import UserError
from lfobench.render.columns import arrange_columns, column_of_failure
from lfobench.render.conditions import check_cell, check_unmixed
from lfobench.render.counting import check_counts, scores_are_success_rates, successes_of
from lfobench.render.footnote import footnote
from lfobench.render.table import Block, Cell, Column, Row, Table, competes
from lfobench.stats.highlight import DEFAULT_RULE, Rule, highlights
from lfobench.stats.sample import Sample, sample_of

Cells = dict[Column, Cell]


def build_table(
    records: Sequence[Record],
    statistic: Statistic = HEADLINE,
    rule: Rule = DEFAULT_RULE,
    tasks: Sequence[str] = (),
    methods: Sequence[str] = (),
    failures: Sequence[Failure] = (),
) -> Table:
    """The table of `records`, one row per task and one column per method, with its generated footnote.

    Args:
        records: from one source under one protocol, in any order.
        statistic: what a run's evaluations are reduced to.
        rule: what is highlighted; its test decides whether cells show scores or success counts.
        tasks: names in row order; tasks not named follow as they first appear.
        methods: names in column order, inside each column group; the others follow as they first appear.
        failures: runs that crashed; counted in the cells that they belong to, where the table has such cells.

    Raises:
        UserError: there are no records, they must not share a table (see `conditions`), or the rule's test cannot
            be made with them.
    """
    if not records:
        raise UserError("There are no records to make a table of.", "Run `lfobench run` first.")
    check_unmixed(records)
    counts = rule.test == "fisher"
    if counts:
        check_counts(records, statistic)
    columns = arrange_columns(records, methods)
    ordered = _in_order([record.task for record in records], tasks)
    cells = {
        task: {
            column: _cell(members, statistic, counts)
            for column, those in columns.items()
            if (members := [record for record in those if record.task == task])
        }
        for task in ordered
    }
    failed = _failed_cells(failures, columns, cells)
    expert = _expert_cells(records)
    shown = [*columns, *dict.fromkeys(column for row in expert.values() for column in row)]
    rows = _rows({task: cells[task] | failed.get(task, {}) for task in ordered}, rule, expert, shown)
    table = Table(
        columns=tuple(shown),
        blocks=_blocks(rows, {record.task: record for record in records}),
        notes=(),
        statistic=statistic,
        rule=rule,
        source=str(records[0].identity["source"]),
        protocol=str(records[0].identity["protocol"]["name"]),
        success_rates=scores_are_success_rates(records),
    )
    return replace(table, notes=footnote(table, columns))


def _in_order(names: Sequence[str], order: Sequence[str]) -> list[str]:
    ranks = {name: rank for rank, name in enumerate(order)}
    return sorted(dict.fromkeys(names), key=lambda name: ranks.get(name, len(ranks)))


def _cell(records: Sequence[Record], statistic: Statistic, counts: bool) -> Cell:
    check_cell(records)
    by_seed = sorted(records, key=lambda record: record.seed)
    return Cell(
        sample=sample_of(
            [record.score(statistic) for record in by_seed],
            _start_scores(by_seed, statistic),
            successes_of(by_seed) if counts else None,
        ),
        seeds=tuple(record.seed for record in by_seed),
        diverged_seeds=tuple(record.seed for record in by_seed if record.status == "diverged"),
    )


def _start_scores(records: Sequence[Record], statistic: Statistic) -> list[float]:
    """The mean over seeds from each common start ``[K]``; empty where seeds differ in their numbers of starts."""
    by_seed = [record.start_scores(statistic) for record in records]
    if len(set(map(len, by_seed))) > 1:
        return []
    return [sum(scores) / len(scores) for scores in zip(*by_seed, strict=True)]


def _failed_cells(
    failures: Sequence[Failure], columns: Mapping[Column, Sequence[Record]], cells: Mapping[str, Cells]
) -> dict[str, Cells]:
    """The cells of `cells` that failures change, with their failed seeds."""
    found: dict[str, Cells] = {}
    for failure in failures:
        column = column_of_failure(failure, columns)
        if column is None or failure.task not in cells:
            continue
        row = found.setdefault(failure.task, {})
        cell = row.get(column) or cells[failure.task].get(column) or Cell(sample=None)
        if failure.seed not in cell.seeds:
            row[column] = replace(cell, failed_seeds=tuple(sorted({*cell.failed_seeds, failure.seed})))
    return found


def _expert_cells(records: Sequence[Record]) -> dict[str, Cells]:
    """The demonstration's score by task, where the records know it."""
    column = Column("demonstration", "demonstration", "", "expert")
    return {
        record.task: {column: Cell(sample_of([float(score)]))}
        for record in records
        # Provenance is free text of whoever wrote the record.
        if usable(score := record.provenance.get("demonstration_score"))
    }


def _rows(cells: Mapping[str, Cells], rule: Rule, others: Mapping[str, Cells], columns: Sequence[Column]) -> list[Row]:
    """Rows of run cells with their highlights, and of `others`, which take no part in them."""
    try:
        decided = highlights([_competing(row, rule) for row in cells.values()], rule)
    except ValueError as error:
        raise UserError(f"The test cannot be made: {error}", "Choose another with --test, e.g. welch.") from error
    rows = []
    for (task, row), outcome in zip(cells.items(), decided, strict=True):
        marked = {
            column: replace(cell, highlighted=column in outcome.methods, lost=outcome.lost and column in outcome.best)
            for column, cell in row.items()
        }
        shown = marked | others.get(task, {})
        rows.append(
            Row(
                task,
                task,
                tuple(shown.get(column) for column in columns),
                outcome.outcome,
                outcome.p,
                outcome.adjusted_p,
            )
        )
    return rows


def _competing(row: Cells, rule: Rule) -> dict[Column, Sample]:
    return {
        column: cell.sample for column, cell in row.items() if cell.sample is not None and competes(column, rule.scope)
    }


def _blocks(rows: Sequence[Row], example: Mapping[str, Record]) -> tuple[Block, ...]:
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
