"""Records in, table out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from lfobench.errors import UserError
from lfobench.record import Failure, Labels, Record, usable
from lfobench.score import HEADLINE, SUCCESS_RATE, Statistic, mean
from lfobench.stats.highlight import DEFAULT_RULE, Rule, highlights
from lfobench.stats.tests import Sample, sample_of
from lfobench.tables.comparable import (
    arrange_columns,
    check_cell,
    check_unmixed,
    column_of_failure,
    crashed_columns,
    fits_row,
    in_order,
)
from lfobench.tables.counting import check_counts, scores_are_success_rates, successes_of
from lfobench.tables.footnote import footnote, highlight_notes, seeds_note
from lfobench.tables.table import Block, Cell, Column, Row, Table, competes
from lfobench.text import counted

Cells = dict[Column, Cell]


def build_table(
    records: Sequence[Record],
    statistic: Statistic | None = None,
    rule: Rule = DEFAULT_RULE,
    tasks: Sequence[str] = (),
    methods: Sequence[str] = (),
    failures: Sequence[Failure] = (),
) -> Table:
    """The table of `records`, one row per task and one column per method, with its generated footnote.

    Args:
        records: from one source under one protocol, in any order.
        statistic: what a run's evaluations are reduced to; by default successes for a rule of counts, else `HEADLINE`.
        rule: what is highlighted; its test decides whether cells show scores or success counts.
        tasks: names in row order; tasks not named follow as they first appear.
        methods: names in column order, inside each column group; the others follow as they first appear.
        failures: runs that crashed; those of other conditions are left out. A task or a method without any record has
            its row or column of crashed cells.

    Raises:
        UserError: there are no records, they must not share a table (see `conditions`), or the rule's test cannot
            be made with them.
    """
    if not records and failures:
        first = failures[0]
        raise UserError(
            f"There is no score: {counted(len(failures), 'run')} crashed and none is done, e.g. {first.method} on "
            f"{first.task}, seed {first.seed}: {first.error}.",
            "'lfobench status' lists them.",
        )
    if not records:
        raise UserError("There are no records to make a table of.", "Run `lfobench run` first.")
    check_unmixed(records)
    counts = rule.test == "fisher"
    if statistic is None:
        statistic = SUCCESS_RATE if counts else HEADLINE
    if counts:
        check_counts(records, statistic)
    columns = arrange_columns(records, methods)
    crashes = _crashes(failures, records, columns)
    ordered = _in_order([*(record.task for record in records), *(each.task for each, _ in crashes)], tasks)
    cells = {
        task: {
            column: _cell(members, statistic, counts)
            for column, those in columns.items()
            if (members := [record for record in those if record.task == task])
        }
        for task in ordered
    }
    failed = _failed_cells(crashes, cells)
    expert = _expert_cells(records)
    run_here = in_order(dict.fromkeys([*columns, *(column for _, column in crashes)]), methods)
    shown = [*run_here, *dict.fromkeys(column for row in expert.values() for column in row)]
    rows = _rows({task: cells[task] | failed.get(task, {}) for task in ordered}, rule, expert, shown)
    crashed = {failure.task: failure.labels for failure, _ in crashes}
    table = Table(
        columns=tuple(shown),
        blocks=_blocks(rows, crashed | {record.task: record.labels for record in records}),
        notes=(),
        statistic=statistic,
        rule=rule,
        source=str(records[0].identity["source"]),
        protocol=str(records[0].identity["protocol"]["name"]),
        success_rates=statistic == SUCCESS_RATE or scores_are_success_rates(records),
    )
    return replace(table, notes=footnote(table, columns))


def decided(table: Table, rule: Rule) -> Table:
    """The same cells under another rule: highlights, outcomes, and the notes that speak of them, and no other notes.

    Raises:
        UserError: the rule's test cannot be made of these cells.
    """
    before = [row for _, row in table.rows()]
    here = {column for column in table.columns if column.run_here}
    by_column = {
        row.task: {column: cell for column, cell in zip(table.columns, row.cells, strict=True) if cell is not None}
        for row in before
    }

    def part(ours: bool) -> dict[str, Cells]:
        return {
            task: {column: cell for column, cell in row.items() if (column in here) is ours}
            for task, row in by_column.items()
        }

    rows = iter(_rows(part(True), rule, part(False), table.columns))
    blocks = tuple(
        replace(block, rows=tuple(replace(next(rows), label=row.label) for row in block.rows)) for block in table.blocks
    )
    again = replace(table, blocks=blocks, rule=rule)
    return replace(again, notes=(*highlight_notes(again), seeds_note(again)))


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
    return [mean(scores) for scores in zip(*by_seed, strict=True)]


def _crashes(
    failures: Sequence[Failure], records: Sequence[Record], columns: Mapping[Column, Sequence[Record]]
) -> list[tuple[Failure, Column]]:
    """The crashed runs that belong to the table of `records`, each with its column."""
    identity = records[0].identity
    ours = [
        failure
        for failure in failures
        if failure.identity["source"] == identity["source"]
        and failure.identity["protocol"]["name"] == identity["protocol"]["name"]
        and fits_row(failure, records)
    ]
    alone = crashed_columns(ours, records)
    found = [(failure, column) for failure in ours if (column := column_of_failure(failure, columns)) is not None]
    return [*found, *((failure, column) for column, members in alone.items() for failure in members)]


def _failed_cells(crashes: Sequence[tuple[Failure, Column]], cells: Mapping[str, Cells]) -> dict[str, Cells]:
    """The cells of `cells` that crashed runs change, with their failed seeds."""
    found: dict[str, Cells] = {}
    for failure, column in crashes:
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
                outcome.without_spread,
            )
        )
    return rows


def _competing(row: Cells, rule: Rule) -> dict[Column, Sample]:
    return {
        column: cell.sample for column, cell in row.items() if cell.sample is not None and competes(column, rule.scope)
    }


def _blocks(rows: Sequence[Row], labels: Mapping[str, Labels]) -> tuple[Block, ...]:
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(labels[row.task].group, []).append(row)
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
        if (shorts := [labels[row.task].row for row in members])
    )
