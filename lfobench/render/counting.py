"""Success counts out of records: which episodes count, and whether all records say how theirs ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isclose

from lfobench.contract.record import SUCCESS, Evaluation, Record
from lfobench.contract.statistic import SUCCESS_RATE, Statistic
from lfobench.errors import UserError
from lfobench.stats.successes import Count, Successes, pool

DIVERGED_OUTCOME = "diverged"
"""How the episodes of a seed ended that diverged: none was run with its policy, and all of them are failures."""

LEAVE_OUT = "leave those records out with --suite or --methods."


def counts_successes(records: Sequence[Record]) -> bool:
    """Whether every record says how its episodes ended; one that diverged before its first evaluation has no say."""
    said = [known for record in records if (known := _says_outcomes(record)) is not None]
    return bool(said) and all(said)


def some_count_successes(records: Sequence[Record]) -> bool:
    """Whether any record says how its episodes ended."""
    return any(_says_outcomes(record) for record in records)


def scores_are_success_rates(records: Sequence[Record]) -> bool:
    """Whether every score is a success rate in per cent: every success scores 100 and every failure 0."""
    return counts_successes(records) and all(
        isclose(record.normalized_score(value), 100.0 if succeeded else 0.0, abs_tol=1e-9)
        for record in records
        for value, succeeded in {pair for evaluation in _evaluations(record) for pair in _returns(evaluation)}
    )


def check_outcomes(records: Sequence[Record], purpose: str, remedy: str) -> None:
    """Refuses records that do not say how their episodes ended; `purpose` says who asks for it.

    Raises:
        UserError: naming the first of them.
    """
    if not counts_successes(records):
        without = [record for record in records if _says_outcomes(record) is False] or records
        raise UserError(
            f"{purpose}, and {len(without)} of {len(records)} records do not say how their episodes ended, e.g. "
            f"{without[0].method} on {without[0].task}.",
            remedy,
        )


def check_counts(records: Sequence[Record], statistic: Statistic) -> None:
    """Refuses records without outcomes, and a statistic that success counts know nothing of.

    Raises:
        UserError: naming the first record that does not say how its episodes ended, or the statistic.
    """
    check_outcomes(
        records, "--test fisher compares success counts", f"Use a test of scores, e.g. --test welch, or {LEAVE_OUT}"
    )
    if statistic != SUCCESS_RATE:
        raise UserError(
            f"--stat {statistic} chooses evaluations for a mean of scores; success counts are of the last evaluation.",
            "Leave it out, or compare scores with --test welch.",
        )


def successes_of(records: Sequence[Record]) -> Successes:
    """The successes of one cell, whose records differ in the seed alone and pass `check_counts`."""
    endings = [(fixed_outcomes(record), further_outcomes(record)) for record in records]
    return pool([_count(fixed) for fixed, _ in endings], [_count([*fixed, *further]) for fixed, further in endings])


def fixed_outcomes(record: Record) -> list[str]:
    """How the episodes of the last evaluation ended, from the fixed test starts."""
    if record.status == "diverged":
        planned = int(record.identity["protocol"]["evaluation_episodes"])
        return [DIVERGED_OUTCOME] * (len(record.evaluations[-1].returns) if record.evaluations else planned)
    return list(record.evaluations[-1].outcomes or ())


def further_outcomes(record: Record) -> list[str]:
    """How the trained policy's episodes from further starts ended; none where there are no such starts."""
    if record.status == "diverged":
        return [DIVERGED_OUTCOME] * further_episodes(record)
    return list(record.further.outcomes or ()) if record.further else []


def further_episodes(record: Record) -> int:
    """Further starts that the protocol plans for this record's task."""
    return int(record.identity["protocol"].get("further_episodes", 0))


def _says_outcomes(record: Record) -> bool | None:
    """None where no episode was run."""
    evaluations = _evaluations(record)
    return all(evaluation.outcomes is not None for evaluation in evaluations) if evaluations else None


def _evaluations(record: Record) -> list[Evaluation]:
    return [*record.evaluations, *([record.further] if record.further else [])]


def _returns(evaluation: Evaluation) -> Iterator[tuple[float, bool]]:
    """Every return and whether its episode succeeded."""
    return zip(evaluation.returns, (outcome == SUCCESS for outcome in evaluation.outcomes or ()), strict=True)


def _count(outcomes: Sequence[str]) -> Count:
    return Count(outcomes.count(SUCCESS), len(outcomes))
