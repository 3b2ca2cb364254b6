"""Captions: what a figure shows, of how many runs, under which protocol, from which source."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from lfobench.contract.record import Record
from lfobench.contract.statistic import SUCCESS_RATE
from lfobench.render.plots.compared import Compared, run_cells
from lfobench.render.plots.text import plain
from lfobench.render.score_notes import STATISTICS
from lfobench.render.table import Cell, Row, Table

DEMONSTRATION = "Dotted: the demonstration that the methods observe."


def score_label(table: Table) -> str:
    """What an axis of scores is called."""
    return "success rate in %" if table.success_rates else "normalised score"


def score_words(table: Table) -> str:
    """What a score is: a sentence without its full stop."""
    if table.success_rates:
        return "The score is the success rate in per cent"
    return "The score is the normalised return, 100 · (return − random) / (expert − random)"


def ends(table: Table) -> str:
    """What the scores 0 and 100 stand for."""
    return "no success and nothing but successes" if table.success_rates else "random actions and the expert"


def references(table: Table) -> str:
    """What the thin lines of a panel are."""
    return f"Lines at 0 and 100 are {ends(table)}."


def fewer_starts(table: Table, records: Sequence[Record]) -> str:
    """That learning curves rest on fewer episodes than the score of a run; empty where they do not."""
    further = any(record.further for record in records if record.status == "finished")
    if table.statistic != SUCCESS_RATE or not further:
        return ""
    return "Evaluations during training are of the fixed test starts alone; a run's score counts further starts too."


def run_score(table: Table) -> str:
    """What the score of one run is."""
    counted = STATISTICS[table.statistic.name].format(step=table.statistic.step)
    return f"{score_words(table)}; each run counts as the {counted}."


def caption(*sentences: str, table: Table) -> str:
    """`sentences`, then how many seeds, which of them diverged or failed, the protocol and the source."""
    known = [f"{note.label}: {note.text}" for note in table.notes if note.label in ("Protocol", "Source")]
    return plain(" ".join(filter(None, [*sentences, *_seeds(table), *known])))


def shared_tasks(compared: Compared) -> str:
    """How many tasks a comparison rests on, and which it leaves out."""
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
