"""Outcomes: for every task and method, how many episodes ended in success and in each kind of failure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from lfobench.errors import UserError
from lfobench.record import SUCCESS, Failure, Record
from lfobench.score import SUCCESS_RATE
from lfobench.stats.highlight import Rule
from lfobench.tables.building import build_table
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.counting import DIVERGED_OUTCOME, LEAVE_OUT, check_outcomes, final_outcomes, fixed_outcomes
from lfobench.tables.document import Document, Grid, Notes, Section
from lfobench.tables.exporters import latex
from lfobench.tables.exporters.csv import csv_text
from lfobench.tables.exporters.json import json_text, notes_value
from lfobench.tables.table import HIGHLIGHT_NOTE, MISSING, Cell, Column, Note, Row, cell_text

_ABOUT_NUMBERS = frozenset({"Score", "Episodes", HIGHLIGHT_NOTE, "†", "Design", "Demonstration"})
"""Notes of a table of success counts that do not apply to outcomes."""


@dataclass(frozen=True)
class Line:
    """One method on one task.

    Attributes:
        group: block of the task.
        row: the task.
        column: the method.
        cell: its seeds, and which of them diverged or failed; None where there is no record.
        counts: episodes by outcome, those of the table's outcomes that occur.
    """

    group: str
    row: Row
    column: Column
    cell: Cell | None
    counts: Mapping[str, int]

    @property
    def episodes(self) -> int:
        """All of them."""
        return sum(self.counts.values())

    def percent(self, outcome: str) -> float:
        """Episodes that ended so, in per cent of all; there must be any."""
        return 100.0 * self.counts.get(outcome, 0) / self.episodes


@dataclass(frozen=True)
class OutcomeTable:
    """Every task and method.

    Attributes:
        outcomes: success first, then the failures, the most frequent first; diverged seeds' episodes last.
        lines: task by task, the methods in column order.
        notes: the footnote.
        source: where the data came from.
        protocol: name of the protocol.
    """

    outcomes: tuple[str, ...]
    lines: tuple[Line, ...]
    notes: tuple[Note, ...]
    source: str
    protocol: str


def outcome_table(
    records: Sequence[Record],
    tasks: Sequence[str] = (),
    methods: Sequence[str] = (),
    failures: Sequence[Failure] = (),
) -> OutcomeTable:
    """Outcomes of the episodes behind success counts; arguments as of `build_table`.

    Raises:
        UserError: there are no records, they must not share a table, or some do not say how their episodes ended.
    """
    if records:
        check_outcomes(records, "--outcomes counts how episodes ended", LEAVE_OUT.capitalize())
    table = build_table(records, SUCCESS_RATE, Rule("fisher"), tasks, methods, failures)
    members = arrange_columns(records, methods)
    lines = tuple(
        Line(
            block.label,
            row,
            column,
            cell,
            _counts([record for record in members.get(column, []) if record.task == row.task]),
        )
        for block, row in table.rows()
        for column, cell in zip(table.columns, row.cells, strict=True)
        if column.run_here
    )
    about = Note(
        "Outcomes",
        "episodes that ended so, and their part of all episodes of the task and method, pooled over seeds: those of "
        "the last evaluation and of the final evaluation where a task has one.",
    )
    notes = (about, *(note for note in table.notes if note.label not in _ABOUT_NUMBERS))
    return OutcomeTable(_in_order(lines), lines, notes, table.source, table.protocol)


def _counts(records: Sequence[Record]) -> Counter[str]:
    return Counter(outcome for record in records for outcome in [*fixed_outcomes(record), *final_outcomes(record)])


def _in_order(lines: Sequence[Line]) -> tuple[str, ...]:
    total: Counter[str] = Counter()
    for line in lines:
        total.update(line.counts)
    failures = sorted(total.keys() - {SUCCESS}, key=lambda each: (each == DIVERGED_OUTCOME, -total[each], each))
    return (SUCCESS, *failures)


def export_outcomes(table: OutcomeTable, format_name: str) -> str:
    """`table` in the named format.

    Raises:
        UserError: outcomes have no such format.
    """
    check_format(format_name)
    return FORMATS[format_name](table)


def check_format(format_name: str) -> None:
    """Refuses a textual format that outcomes do not have.

    Raises:
        UserError: naming those that they have.
    """
    if format_name not in FORMATS:
        raise UserError(
            f"--outcomes has no format '{format_name}'.", f"Choose terminal, {', '.join(FORMATS)} with --format."
        )


def document(table: OutcomeTable) -> Document:
    """`table` for a terminal and in Markdown."""
    sections = [
        Section(row.task, "bold", [[_label(line), *_numbers(table, line)] for line in lines])
        for row, lines in _by_task(table)
    ]
    return Document((Grid(["episodes", *table.outcomes], sections, ("Task", "Method")), Notes(table.notes)))


def _markdown(table: OutcomeTable) -> str:
    return document(table).markdown()


def _latex(table: OutcomeTable) -> str:
    escape = latex.escape
    lines = [
        r"% Needs \usepackage{booktabs}.",
        r"\begin{table}[t]",
        r"\centering\footnotesize\setlength{\tabcolsep}{3pt}",
        rf"\begin{{tabular}}{{@{{}}l{'r' * (len(table.outcomes) + 1)}@{{}}}}",
        r"\toprule",
        " & ".join(["Method", "episodes", *map(escape, table.outcomes)]) + r" \\",
    ]
    for row, of_task in _by_task(table):
        lines += [r"\midrule", rf"\multicolumn{{{len(table.outcomes) + 2}}}{{@{{}}l}}{{{escape(row.task)}}} \\"]
        lines += [
            " & ".join([rf"\quad {escape(_label(line))}", *map(escape, _numbers(table, line))]) + r" \\"
            for line in of_task
        ]
    return "\n".join([*lines, *latex.ending(table.notes)]) + "\n"


def _comma_separated(table: OutcomeTable) -> str:
    return csv_text(
        (
            {
                "group": line.group,
                "row": line.row.label,
                "task": line.row.task,
                "column": line.column.label,
                "method": line.column.method,
                "preset": line.column.preset,
                "outcome": outcome,
                "count": line.counts.get(outcome, 0),
                "episodes": line.episodes,
                "percent": line.percent(outcome),
                "seeds": line.cell.seeds,
                "diverged_seeds": line.cell.diverged_seeds,
                "failed_seeds": line.cell.failed_seeds,
                "source": table.source,
                "protocol": table.protocol,
            }
            for line in table.lines
            if line.cell is not None and line.episodes
            for outcome in table.outcomes
        ),
    )


def _json(table: OutcomeTable) -> str:
    return json_text(
        {
            "source": table.source,
            "protocol": table.protocol,
            "outcomes": table.outcomes,
            "rows": [
                {
                    "group": line.group,
                    "row": line.row.label,
                    "task": line.row.task,
                    "column": line.column.label,
                    "method": line.column.method,
                    "preset": line.column.preset,
                    "episodes": line.episodes,
                    "outcomes": {outcome: line.counts.get(outcome, 0) for outcome in table.outcomes},
                    "seeds": line.cell.seeds if line.cell else (),
                    "diverged_seeds": line.cell.diverged_seeds if line.cell else (),
                    "failed_seeds": line.cell.failed_seeds if line.cell else (),
                }
                for line in table.lines
            ],
            "notes": notes_value(table.notes),
        }
    )


FORMATS: dict[str, Callable[[OutcomeTable], str]] = {
    "markdown": _markdown,
    "latex": _latex,
    "csv": _comma_separated,
    "json": _json,
}


def _by_task(table: OutcomeTable) -> Iterator[tuple[Row, list[Line]]]:
    for _, lines in groupby(table.lines, key=lambda line: line.row.task):
        of_task = list(lines)
        yield of_task[0].row, of_task


def _label(line: Line) -> str:
    """The method, and how many of its seeds diverged or failed: ``dilo ✗1 !2``."""
    marks = cell_text(line.cell).marks if line.cell else ""
    return f"{line.column.label} {marks}".rstrip()


def _numbers(table: OutcomeTable, line: Line) -> list[str]:
    """Episodes, then every outcome: ``61 (87%)``."""
    if not line.episodes:
        return [cell_text(line.cell).mean if line.cell else MISSING] * (len(table.outcomes) + 1)
    return [str(line.episodes), *(_share(line, outcome) for outcome in table.outcomes)]


def _share(line: Line, outcome: str) -> str:
    count = line.counts.get(outcome, 0)
    if not count:
        return "0"
    percent = f"{line.percent(outcome):.0f}"
    if percent == "0":
        percent = "<1"
    elif percent == "100" and count < line.episodes:
        percent = ">99"
    return f"{count} ({percent}%)"
