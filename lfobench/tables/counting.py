"""Success counts out of records: which episodes count, and whether all records say how theirs ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isclose
from typing import cast, get_args

from lfobench.errors import UserError, unknown_name
from lfobench.record import SUCCESS, Evaluation, Record
from lfobench.score import HEADLINE, SUCCESS_RATE, Statistic, parse_statistic
from lfobench.stats.highlight import Rule
from lfobench.stats.options import Correction, HighlightTest, Scope
from lfobench.stats.successes import Count, Successes, pool

DIVERGED_OUTCOME = "diverged"
"""Outcome of the episodes of a diverged seed: none was run with its policy, and all of them are failures."""

LEAVE_OUT = "leave those records out with --suite or --methods."


def counts_successes(records: Sequence[Record]) -> bool:
    """Whether every record says how its episodes ended; one that diverged before its first evaluation is left out."""
    recorded = [known for record in records if (known := _has_outcomes(record)) is not None]
    return bool(recorded) and all(recorded)


def some_count_successes(records: Sequence[Record]) -> bool:
    """Whether any record says how its episodes ended."""
    return any(_has_outcomes(record) for record in records)


def scores_are_success_rates(records: Sequence[Record]) -> bool:
    """Whether every score is a success rate in per cent: every success scores 100 and every failure 0."""
    return counts_successes(records) and all(
        isclose(record.normalized_score(value), 100.0 if succeeded else 0.0, abs_tol=1e-9)
        for record in records
        for value, succeeded in {pair for evaluation in _evaluations(record) for pair in _returns(evaluation)}
    )


def check_outcomes(records: Sequence[Record], purpose: str, remedy: str) -> None:
    """Refuses records without outcomes; `purpose` begins the error.

    Raises:
        UserError: naming the first of them.
    """
    if not counts_successes(records):
        without = [record for record in records if _has_outcomes(record) is False] or records
        raise UserError(
            f"{purpose}, and {len(without)} of {len(records)} records do not say how their episodes ended, e.g. "
            f"{without[0].method} on {without[0].task}.",
            remedy,
        )


def check_counts(records: Sequence[Record], statistic: Statistic) -> None:
    """Refuses records without outcomes, and a statistic other than success rates.

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
    endings = [(fixed_outcomes(record), final_outcomes(record)) for record in records]
    return pool([_count(fixed) for fixed, _ in endings], [_count([*fixed, *further]) for fixed, further in endings])


def fixed_outcomes(record: Record) -> list[str]:
    """Outcomes of the episodes of the last evaluation, from the fixed test starts."""
    if record.status == "diverged":
        planned = int(record.identity["protocol"]["evaluation_episodes"])
        return [DIVERGED_OUTCOME] * (len(record.evaluations[-1].returns) if record.evaluations else planned)
    return list(record.evaluations[-1].outcomes or ())


def final_outcomes(record: Record) -> list[str]:
    """Outcomes of the final evaluation, the trained policy's episodes from further starts; empty without one."""
    if record.status == "diverged":
        return [DIVERGED_OUTCOME] * final_episodes(record)
    return list(record.further.outcomes or ()) if record.further else []


def final_episodes(record: Record) -> int:
    """Episodes of the final evaluation in the protocol of this record's task."""
    return int(record.identity["protocol"].get("further_episodes", 0))


def _has_outcomes(record: Record) -> bool | None:
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


def knobs(
    records: Sequence[Record],
    statistic: str | None = None,
    test: str | None = None,
    scope: str = "group",
    correction: str = "none",
    alpha: float = 0.05,
) -> tuple[Statistic, Rule]:
    """The score and the rule of every view of `records`: table, report, figure, comparison, from Python too.

    Where all records say how their episodes ended, runs are scored by ``success`` and compared by ``fisher``, else by
    ``last5`` and ``welch``. A `statistic` brings its own test, ``fisher`` with ``success`` and ``welch`` with the
    others, and ``fisher`` brings ``success``.

    Raises:
        UserError: an unknown name, or a level outside 0 to 1.
    """
    if statistic is not None:
        scored = parse_statistic(statistic)
    else:
        scored = SUCCESS_RATE if test == "fisher" or counts_successes(records) else HEADLINE
    compared = test if test is not None else "fisher" if scored == SUCCESS_RATE else "welch"
    for kind, name, known in (
        ("test", compared, get_args(HighlightTest)),
        ("scope", scope, get_args(Scope)),
        ("correction", correction, get_args(Correction)),
    ):
        if name not in known:
            raise unknown_name(kind, name, known)
    if not 0.0 < alpha < 1.0:
        raise UserError(f"alpha = {alpha} is not a level.", "Choose one between 0 and 1, e.g. 0.05.")
    rule = Rule(cast("HighlightTest", compared), cast("Scope", scope), cast("Correction", correction), alpha)
    return scored, rule
