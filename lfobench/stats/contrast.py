"""A subject compared with a reference, cell by cell: a verdict for each, and one number over all of them.

The cells are many questions of one kind, so their p-values are corrected together: a gate over forty cells at level
0.05 would raise two alarms in every run where nothing has changed.

References:
    S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979.
    R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare, "Deep reinforcement learning at the edge
    of the statistical precipice", NeurIPS 2021: probability of improvement, interquartile mean, stratified bootstrap.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Generic, Literal, TypeAlias, TypeVar

import numpy as np

from lfobench.stats.aggregates import (
    REPLICATES,
    Counts,
    Strata,
    Values,
    bootstrap,
    interquartile_statistic,
    percentile_interval,
    probability_of_improvement,
    strata,
)
from lfobench.stats.highlight import Rule, adjusted
from lfobench.stats.intervals import Estimate, Interval, check_probability, welch_interval
from lfobench.stats.options import HighlightTest, Verdict
from lfobench.stats.power import can_reach, smallest_p
from lfobench.stats.successes import newcombe_interval
from lfobench.stats.tests import PAIRED, Sample, counted, margin, p_value, without_spread

Key = TypeVar("Key", bound=Hashable)

Outcome: TypeAlias = Verdict | Literal["untested"]
"""A verdict, or that there was no test: one of the two has a single score, from which no spread can be estimated."""


@dataclass(frozen=True)
class Comparison:
    """The subject against the reference on one cell.

    Attributes:
        subject: its scores.
        reference: scores to compare with.
        difference: mean of the subject minus mean of the reference, in points, or success rate minus success rate where
            counts are compared; 0 where the two are level.
        interval: of the difference at level 1 - α, for this cell alone: Welch's, and None where either has one seed; of
            success rates Newcombe's.
        p: two-sided p-value of the rule's test; None where there is no test.
        adjusted_p: `p` corrected over all cells tested.
        outcome: `better` or `worse`, by the sign of the difference, where `adjusted_p` is below α.
        reachable: whether any scores of so many seeds could have led to a verdict, even with all the other cells as
            clear as can be.
        without_spread: whether `p` is a limit, for want of any spread that a t-test could estimate.
    """

    subject: Sample
    reference: Sample
    difference: float
    interval: Interval | None
    p: float | None
    adjusted_p: float | None
    outcome: Outcome
    reachable: bool
    without_spread: bool


@dataclass(frozen=True)
class Aggregate(Generic[Key]):
    """The subject against the reference over all cells where both have two seeds; such cells count equally.

    Attributes:
        cells: which.
        improvement: probability that a run of the subject beats a run of the reference on a cell.
        interquartile_mean: of the subject minus that of the reference, in points.
    """

    cells: tuple[Key, ...]
    improvement: Estimate
    interquartile_mean: Estimate


@dataclass(frozen=True)
class Contrast(Generic[Key]):
    """Every cell, and all of them together; `aggregate` is None where no cell has two seeds in both."""

    cells: Mapping[Key, Comparison]
    aggregate: Aggregate[Key] | None

    def having(self, outcome: Outcome) -> list[Key]:
        """The cells of one outcome, in the order given."""
        return [key for key, cell in self.cells.items() if cell.outcome == outcome]

    @property
    def tested(self) -> list[Key]:
        """The cells that share the correction."""
        return [key for key, cell in self.cells.items() if cell.p is not None]


def contrast(pairs: Mapping[Key, tuple[Sample, Sample]], rule: Rule, replicates: int = REPLICATES) -> Contrast[Key]:
    """The subject's sample of every cell against the reference's; a higher score is better.

    Raises:
        ValueError: the rule's test needs scores or counts that a sample lacks, or α is not strictly between 0 and 1.
    """
    check_probability("alpha", rule.alpha)
    p_values = {key: p_value(rule.test, *pair) for key, pair in pairs.items()}
    tested = {key: p for key, p in p_values.items() if p is not None}
    corrected = dict(zip(tested, adjusted(list(tested.values()), rule.correction), strict=True))
    cells = {
        key: _comparison(subject, reference, p_values[key], corrected.get(key), len(tested), rule)
        for key, (subject, reference) in pairs.items()
    }
    return Contrast(cells, _aggregate(pairs, 1.0 - rule.alpha, replicates))


def scores_compared(test: HighlightTest, sample: Sample) -> int:
    """Sample size of a test: start states where paired, episodes for `fisher`, else seeds."""
    if test == "fisher":
        return counted(sample).pooled.trials
    return len(sample.starts) if test in PAIRED else sample.summary.n


def best_p(comparison: Comparison, test: HighlightTest) -> float | None:
    """The smallest p-value that the test could have given with so many scores, before any correction."""
    return smallest_p(test, scores_compared(test, comparison.subject), scores_compared(test, comparison.reference))


def _comparison(
    subject: Sample, reference: Sample, p: float | None, adjusted_p: float | None, tested: int, rule: Rule
) -> Comparison:
    difference = margin(rule.test, subject, reference)
    outcome: Outcome = "undecided"
    if adjusted_p is None:
        outcome = "untested"
    elif adjusted_p < rule.alpha and difference != 0.0:
        outcome = "better" if difference > 0.0 else "worse"
    sizes = scores_compared(rule.test, subject), scores_compared(rule.test, reference)
    return Comparison(
        subject,
        reference,
        difference,
        _interval(subject, reference, rule),
        p,
        adjusted_p,
        outcome,
        p is not None and can_reach(rule.test, *sizes, rule.alpha, tested, rule.correction),
        p is not None and without_spread(rule.test, subject, reference),
    )


def _interval(subject: Sample, reference: Sample, rule: Rule) -> Interval | None:
    if rule.test != "fisher":
        return welch_interval(subject.summary, reference.summary, 1.0 - rule.alpha)
    one, two = counted(subject).pooled, counted(reference).pooled
    found = newcombe_interval(one.successes, one.trials, two.successes, two.trials, 1.0 - rule.alpha)
    return Interval(100.0 * found.low, 100.0 * found.high, found.level)


def _aggregate(pairs: Mapping[Key, tuple[Sample, Sample]], level: float, replicates: int) -> Aggregate[Key] | None:
    # A cell with one seed adds no spread, and would make the intervals narrower than they are.
    spread = {key: pair for key, pair in pairs.items() if min(len(sample.seeds) for sample in pair) > 1}
    if not spread:
        return None
    subject, reference = ([pair[which].seeds for pair in spread.values()] for which in (0, 1))
    return Aggregate(
        tuple(spread),
        probability_of_improvement(subject, reference, level, replicates),
        _difference_of_interquartile_means(strata(subject), strata(reference), level, replicates),
    )


def _difference_of_interquartile_means(subject: Strata, reference: Strata, level: float, replicates: int) -> Estimate:
    """The percentile interval is of two independent, stratified bootstraps."""
    one, two = interquartile_statistic(subject), interquartile_statistic(reference)

    def statistic(counts_one: Counts, counts_two: Counts) -> Values:
        return one(counts_one) - two(counts_two)

    value = statistic(*(np.ones((pool.values.size, 1)) for pool in (subject, reference)))[0]
    low, high = percentile_interval(bootstrap(statistic, [subject, reference], replicates), level)
    return Estimate(float(value), Interval(float(low), float(high), level))
