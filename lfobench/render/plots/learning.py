"""Learning curves as numbers: every seed's scores, their mean and its interval, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lfobench.contract.record import Record
from lfobench.contract.statistic import Statistic
from lfobench.render.plots.compared import LEVEL
from lfobench.stats.intervals import Interval, t_interval
from lfobench.stats.summary import summarize

DIVERGED_SCORE = 0.0
"""What a seed counts as from its divergence on, as in a table."""


@dataclass(frozen=True)
class Curve:
    """Scores of one method on one task.

    Attributes:
        steps: gradient steps ``[T]`` of the evaluations.
        seeds: the scores of each seed, ``[n][T]``; None where it was not evaluated.
        means: over the seeds with a score, ``[T]``.
        intervals: t-intervals of the means, ``[T]``; None where fewer than two seeds have a score.
        diverged: steps at which seeds diverged.
    """

    steps: list[int]
    seeds: list[list[float | None]]
    means: list[float]
    intervals: list[Interval | None]
    diverged: list[int]


def evaluated(records: Sequence[Record]) -> list[int]:
    """The steps at which any of `records` was evaluated, ascending."""
    return sorted({evaluation.step for record in records for evaluation in record.evaluations})


def learning_curve(records: Sequence[Record], steps: Sequence[int], statistic: Statistic) -> Curve | None:
    """The curve of one cell's `records` over its task's evaluation `steps`; None where it has no score at any.

    Of every evaluation it shows the success rate where `statistic` counts successes, else the mean normalised score.
    """
    seeds = {record.seed: _scores(record, steps, statistic) for record in records}
    kept, means, intervals = [], [], []
    for index in range(len(steps)):
        found = [score for scores in seeds.values() if (score := scores[index]) is not None]
        if found:
            summary = summarize(found)
            kept.append(index)
            means.append(summary.mean)
            intervals.append(t_interval(summary, LEVEL))
    if not kept:
        return None
    return Curve(
        [steps[index] for index in kept],
        [[scores[index] for index in kept] for scores in seeds.values()],
        means,
        intervals,
        [_end(record) for record in records if record.status == "diverged"],
    )


def _scores(record: Record, steps: Sequence[int], statistic: Statistic) -> list[float | None]:
    measured: dict[int, float] = dict(record.curve(statistic))
    if record.status != "diverged":
        return [measured.get(step) for step in steps]
    end = _end(record)
    return [measured.get(step) if step < end else DIVERGED_SCORE for step in steps]


def _end(record: Record) -> int:
    """The step of divergence; where the record does not say, the last evaluation's, or the start."""
    if record.diverged_at is not None:
        return record.diverged_at
    return max((evaluation.step for evaluation in record.evaluations), default=0)
