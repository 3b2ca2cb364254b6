"""The part of the footnote that says what a number is: a score, or successes out of episodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lfobench.contract.record import Record
from lfobench.contract.statistic import SUCCESS_RATE
from lfobench.render.counting import counts_successes, fixed_outcomes, further_outcomes, some_count_successes
from lfobench.render.table import Note, Table
from lfobench.render.wording import either
from lfobench.words import short_number

STATISTICS: dict[str, str] = {
    "last5": "mean of the last 5 evaluations",
    "last": "last evaluation",
    "best": "best evaluation, picked by the score it reports and therefore optimistic",
    "at": "evaluation at step {step:,}",
    "success": "percentage of successes among the episodes of its last policy, those from further starts included",
}

_RETURN = "normalised return, 100 · (return − random) / (expert − random)"


def score_notes(table: Table, records: Sequence[Record]) -> Iterator[Note]:
    """What a cell shows; where it counts pooled episodes, how far from independent they are."""
    if table.counts:
        yield _counts(records)
        yield _dependence(table)
    else:
        yield _scores(table, records)


def _scores(table: Table, records: Sequence[Record]) -> Note:
    statistic = table.statistic
    if statistic == SUCCESS_RATE:
        what = f"success rate in % of one episode of the last policy from each of {_starts(records)}"
        return Note("Score", f"{what}; mean ± sample standard deviation over seeds.{_why_scores(records)}")
    rates = "success rate in % of the episodes from the fixed test starts"
    what = rates if table.success_rates else f"{_RETURN}, where {_references(records)}"
    text = (
        f"{what}; mean ± sample standard deviation "
        f"over seeds. Each seed counts as the {STATISTICS[statistic.name].format(step=statistic.step)}"
    )
    fewest = min((len(record.evaluations) for record in records if record.status == "finished"), default=5)
    if statistic.name == "last5" and fewest < 5:
        text += f" (of all of them where a run has fewer; the shortest has {fewest})"
    return Note("Score", f"{text}.{_why_scores(records)}")


def _references(records: Sequence[Record]) -> str:
    """Which returns score 0 and 100."""
    returns = dict.fromkeys(
        f"{record.labels.row} {_number(environment['random_return'])} and {_number(environment['expert_return'])}"
        for record in records
        for environment in [record.identity["environment"]]
    )
    return f"random and expert are fixed references ({'; '.join(returns)}), not the demonstration of this table"


def _number(value: float) -> str:
    return short_number(value, ",.1f").removesuffix(".0")


def _why_scores(records: Sequence[Record]) -> str:
    if counts_successes(records):
        return (
            " Every record says how its episodes ended: without --stat and --test, lfobench table shows success counts "
            "instead, further starts included."
        )
    if some_count_successes(records):
        return " Scores, not success counts, because some records do not say how their episodes ended."
    return ""


def _counts(records: Sequence[Record]) -> Note:
    return Note(
        "Score",
        "successes/episodes, and Wilson's 95% interval of the success rate in %. Pooled over seeds: each adds one "
        f"episode of its last policy from each of {_starts(records)}.",
    )


def _starts(records: Sequence[Record]) -> str:
    """``the 10 fixed test starts and 100 further ones, the same for every method and seed``."""
    fixed = either(len(fixed_outcomes(record)) for record in records)
    further = [len(further_outcomes(record)) for record in records]
    beyond = f" and {either(further)} further ones, the same for every method and seed" if any(further) else ""
    return f"the {fixed} fixed test starts{beyond}"


def _dependence(table: Table) -> Note:
    known = [
        (inflation, f"{column.label} on {row.task}")
        for row, column, cell in table.cells()
        if cell and cell.successes and (inflation := cell.successes.inflation) is not None
    ]
    what = "variance inflation by seeds (Rao and Scott 1992; 1 is none)"
    if known:
        largest, where = max(known)
        extent = f"Largest {what}: {largest:.1f}, {where}."
    else:
        extent = f"The {what} is unknown: it takes two seeds of a cell, and successes beside failures."
    return Note(
        "Episodes",
        "episodes of one seed share its policy and are not independent: where seeds differ, intervals and p-values "
        f"that pool episodes are too small. {extent} --test welch takes seeds as the unit.",
    )
