"""Captions: what a figure shows, of how many runs, under which protocol, from which source."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from lfobench.errors import UserError
from lfobench.plots.figure import one_line
from lfobench.record import Record
from lfobench.score import SUCCESS_RATE
from lfobench.tables.footnote import STATISTICS
from lfobench.tables.table import Cell, Column, Row, Table

LEVEL = 0.95
"""Nominal coverage of every interval and band that is drawn."""


@dataclass(frozen=True)
class Compared:
    """Methods on the tasks that they share; other tasks would favour the methods that lack them.

    Attributes:
        scores: the scores over seeds ``[n]`` of each task, by column.
        tasks: the tasks, in row order.
        left_out: tasks on which a method has no score.
    """

    scores: Mapping[Column, Sequence[Sequence[float]]]
    tasks: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def columns(self) -> tuple[Column, ...]:
        """The methods, in table order."""
        return tuple(self.scores)


def run_columns(table: Table) -> tuple[Column, ...]:
    """The columns of methods that were run here."""
    return tuple(column for column in table.columns if column.run_here)


def run_cells(table: Table, row: Row) -> dict[Column, Cell]:
    """The cells of a row that show runs, failed ones included."""
    return {
        column: cell
        for column, cell in zip(table.columns, row.cells, strict=True)
        if column.run_here and cell is not None
    }


def demonstration_score(table: Table, row: Row) -> float | None:
    """Score of the demonstration that the methods observe on a task, where the table knows it."""
    return next(
        (
            cell.summary.mean
            for column, cell in zip(table.columns, row.cells, strict=True)
            if column.kind == "expert" and cell is not None and cell.summary is not None
        ),
        None,
    )


def compare(table: Table) -> Compared:
    """The scores of all methods of `table` on the tasks that they share; methods without any score take no part.

    Raises:
        UserError: there is no such task.
    """
    scored = {column for _, column, cell in table.cells() if cell is not None and cell.sample is not None}
    columns = tuple(column for column in run_columns(table) if column in scored)
    shared, left_out = {}, []
    for _, row in table.rows():
        samples = {column: cell.sample for column, cell in run_cells(table, row).items() if cell.sample is not None}
        if len(samples) == len(columns):
            shared[row.task] = samples
        else:
            left_out.append(row.task)
    if not shared:
        raise UserError(
            f"On no task do all of {', '.join(column.label for column in columns)} have a score.",
            "Name the methods to compare with --methods, or run what is missing.",
        )
    return Compared(
        {column: [samples[column].seeds for samples in shared.values()] for column in columns},
        tuple(shared),
        tuple(left_out),
    )


DEMONSTRATION = "Dotted: the demonstration that the methods observe."


def score_label(table: Table) -> str:
    """Label of an axis of scores."""
    return "success rate in %" if table.success_rates else "normalised score"


def score_sentence(table: Table) -> str:
    """Definition of a score: a sentence without its full stop."""
    if table.success_rates:
        return "The score is the success rate in per cent"
    return "The score is the normalised return, 100 · (return − random) / (expert − random)"


def ends(table: Table) -> str:
    """Meaning of the scores 0 and 100."""
    return "no success and nothing but successes" if table.success_rates else "random actions and the expert"


def references(table: Table) -> str:
    """Explanation of the thin lines of a panel."""
    return f"Lines at 0 and 100 are {ends(table)}."


def fewer_starts(table: Table, records: Sequence[Record]) -> str:
    """That learning curves rest on fewer episodes than the score of a run; empty where they do not."""
    further = any(record.further for record in records if record.status == "finished")
    if table.statistic != SUCCESS_RATE or not further:
        return ""
    return "Evaluations during training are of the fixed test starts; a run's score counts the final evaluation too."


def run_score(table: Table) -> str:
    """Definition of the score of one run."""
    counted = STATISTICS[table.statistic.name].format(step=table.statistic.step)
    return f"{score_sentence(table)}; each run counts as the {counted}."


def caption(*sentences: str, table: Table) -> str:
    """`sentences`, then how many seeds, which of them diverged or failed, the protocol and the source."""
    known = [f"{note.label}: {note.text}" for note in table.notes if note.label in ("Protocol", "Source")]
    return one_line(" ".join(filter(None, [*sentences, *_seeds(table), *known])))


def shared_tasks(compared: Compared) -> str:
    """Number of tasks in a comparison, and the tasks that it leaves out."""
    count = len(compared.tasks)
    text = f"Over {count} {'task' if count == 1 else 'tasks'}"
    if compared.left_out:
        text += f", without {', '.join(compared.left_out)}, where a method has no score"
    return f"{text}."


def _seeds(table: Table) -> Iterator[str]:
    counts = {len(cell.seeds) for _, row in table.rows() for cell in run_cells(table, row).values() if cell.seeds}
    if counts:
        yield f"Seeds per task and method: n = {' to '.join(map(str, sorted({min(counts), max(counts)})))}."
    for verb, seeds in (
        ("Diverged, counted as score 0", lambda cell: cell.diverged_seeds),
        ("Crashed, without a score", lambda cell: cell.failed_seeds),
    ):
        found = list(_runs(table, seeds))
        if found:
            yield f"{verb}: {'; '.join(found)}."
    missing = [
        f"{column.label} on {row.task}" for row, column, cell in table.cells() if column.run_here and cell is None
    ]
    if missing:
        yield f"Without any run: {', '.join(missing)}."


def _runs(table: Table, seeds: Callable[[Cell], Sequence[int]]) -> Iterator[str]:
    for row, label, cell in _labelled(table):
        if chosen := seeds(cell):
            yield f"{label} on {row.task}, seed {', '.join(map(str, chosen))}"


def _labelled(table: Table) -> Iterator[tuple[Row, str, Cell]]:
    for _, row in table.rows():
        for column, cell in run_cells(table, row).items():
            yield row, column.label, cell
