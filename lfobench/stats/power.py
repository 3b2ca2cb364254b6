"""Power of Welch's t-test, and the number of seeds that an effect needs.

References:
    B. L. Welch, "The generalization of 'Student's' problem when several different population variances are
    involved", Biometrika 34, 1947: the test, whose degrees of freedom are estimated from the two samples.
    J. Cohen, "Statistical Power Analysis for the Behavioral Sciences", 1988, chapter 2: effects in units of the
    standard deviation, power from the noncentral t distribution.
    C. Colas, O. Sigaud, P.-Y. Oudeyer, "How many random seeds? Statistical power analysis in deep reinforcement
    learning experiments", arXiv:1806.08295, 2018.
    L. N. Trefethen, J. A. C. Weideman, "The exponentially convergent trapezoidal rule", SIAM Review 56, 2014.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np
from numpy.typing import NDArray

from lfobench.stats.intervals import Interval, Summary, check_probability
from lfobench.stats.options import Correction, HighlightTest
from lfobench.stats.tests import EXACT_RELABELLINGS, PAIRED, RANDOM_RELABELLINGS, T_TESTS

_STEP = 0.25
_TAIL = 1e-10
"""Step and tail of the quadrature over the ratio of variances; the error of the power is below 1e-8."""

_NO_OTHER_TAIL = 10.0
"""Noncentrality from which on the test rejects in the wrong tail with a probability below 1e-23."""


def power(effect: float, n: int, alpha: float = 0.05) -> float:
    """Probability that Welch's two-sided test rejects, with `n` samples each and equal variances.

    `effect` is the difference of the expectations over the common standard deviation (Cohen's d). One sample each
    rejects nothing: power 0.

    Raises:
        ValueError: there is no sample, the effect is not finite, or α is not strictly between 0 and 1.
    """
    return power_for(effect, 1.0, 1.0, n, alpha)


def power_for(difference: float, std_first: float, std_second: float, n: int, alpha: float = 0.05) -> float:
    """Power of Welch's two-sided test, with `n` normal samples each and these true standard deviations.

    The degrees of freedom that Welch's test estimates depend on the ratio of the two sample variances alone. Given
    that ratio, the statistic times a constant is noncentral t with 2 n - 2 degrees of freedom, since the sum of the
    variances over their expectations is independent of the ratio; the power is the mean over the ratio, a quadrature
    in one dimension. Few samples make it markedly smaller than Student's. Without spread any difference has power 1.

    Raises:
        ValueError: there is no sample, a number is not finite, a standard deviation is negative, or α is not
            strictly between 0 and 1.
    """
    check_probability("alpha", alpha)
    if n < 1:
        raise ValueError(f"A test needs at least one sample of each method; got {n}.")
    if not math.isfinite(difference) or not (0.0 <= std_first < math.inf and 0.0 <= std_second < math.inf):
        raise ValueError(f"Not an effect: {difference} with standard deviations {std_first} and {std_second}.")
    if n == 1:
        return 0.0
    # Working in units of the larger spread keeps squares from underflowing and from overflowing.
    unit = max(std_first, std_second)
    if unit == 0.0:
        return float(difference != 0.0)
    first, second = (std_first / unit) ** 2, (std_second / unit) ** 2
    noncentrality = abs(difference) / unit / math.sqrt((first + second) / n)
    from scipy.special import stdtrit
    from scipy.stats import nct

    shares, weights = _variance_shares(n)
    one, two = first * shares, second * (1.0 - shares)
    degrees = (n - 1) * (one + two) ** 2 / (one**2 + two**2)
    critical = stdtrit(degrees, 1.0 - alpha / 2.0) * np.sqrt(2.0 * (one + two) / (first + second))
    rejected = nct.sf(critical, 2 * n - 2, noncentrality)
    if noncentrality < _NO_OTHER_TAIL:
        # The lower tail as the upper one of the mirrored variable: nct.cdf gives nan far out.
        rejected = rejected + nct.sf(critical, 2 * n - 2, -noncentrality)
    return min(1.0, float(weights @ rejected))


def seeds_needed(effect: float, power: float = 0.8, alpha: float = 0.05, most: int = 1000) -> int | None:
    """The fewest seeds per method that detect an effect with this power; None if that takes over `most`.

    Raises:
        ValueError: the effect is not finite, or `power` or α is not strictly between 0 and 1.
    """
    return seeds_needed_for(effect, 1.0, 1.0, power, alpha, most)


def seeds_needed_for(
    difference: float,
    std_first: float,
    std_second: float,
    power: float = 0.8,
    alpha: float = 0.05,
    most: int = 1000,
) -> int | None:
    """`seeds_needed` for a difference and two standard deviations in the scores' unit, by `power_for`.

    Raises:
        ValueError: as `power_for`, or `power` is not strictly between 0 and 1.
    """
    check_probability("power", power)
    return _fewest(lambda n: power_for(difference, std_first, std_second, n, alpha) >= power, most)


def detectable_effect(n: int, power: float = 0.8, alpha: float = 0.05) -> float | None:
    """The smallest effect that `n` seeds per method show with this power, in standard deviations; None for n < 2.

    Raises:
        ValueError: `power` or α is not strictly between 0 and 1.
    """
    return detectable_difference(1.0, 1.0, n, power, alpha)


def detectable_difference(std_first: float, std_second: float, n: int, power: float, alpha: float) -> float | None:
    """The smallest difference, in points, that `n` seeds per method show with this power; None for n < 2.

    The inverse of `power_for`; 0 where chance alone reaches the power, or without any spread.

    Raises:
        ValueError: as `power_for`, or `power` is not strictly between 0 and 1.
    """
    check_probability("power", power)
    check_probability("alpha", alpha)
    if n < 2:
        return None
    unit = max(std_first, std_second)
    if unit == 0.0:
        return 0.0
    from scipy.optimize import brentq

    one, two = std_first / unit, std_second / unit
    if power_for(0.0, one, two, n, alpha) >= power:
        return 0.0
    high = 1.0
    while power_for(high, one, two, n, alpha) < power:
        high *= 2.0
    found = brentq(lambda difference: power_for(difference, one, two, n, alpha) - power, 0.0, high, xtol=1e-9)
    return float(found) * unit


@lru_cache(maxsize=256)
def _variance_shares(n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights for the first sample's share of the two variances, each over its expectation.

    The share w of `n` normal samples each has the density of Beta((n - 1)/2, (n - 1)/2). The trapezoidal rule
    over the logarithm of w / (1 - w) converges exponentially, however unequal the true variances are.
    """
    from scipy.special import expit, logit, polygamma
    from scipy.stats import beta

    shape = (n - 1) / 2.0
    furthest = -float(logit(beta.ppf(_TAIL, shape, shape)))
    spread = math.sqrt(2.0 * float(polygamma(1, shape)))
    nodes = math.ceil(2.0 * furthest / min(_STEP, spread / 2.0)) + 1
    logarithms = np.linspace(-furthest, furthest, nodes)
    shares = expit(logarithms)
    weights = (4.0 * shares * expit(-logarithms)) ** shape
    return shares, weights / weights.sum()


def _fewest(enough: Callable[[int], bool], most: int) -> int | None:
    """The smallest n from 2 to `most` for which `enough` holds, given that it then holds for all larger n."""
    low, high = 2, most
    if most < 2 or not enough(most):
        return None
    while low < high:
        middle = (low + high) // 2
        if enough(middle):
            high = middle
        else:
            low = middle + 1
    return low


def smallest_p(test: HighlightTest, n: int, m: int) -> float | None:
    """The smallest two-sided p-value of `test` with n and m scores, or episodes for Fisher's; None where there is none.

    A t-test has none above 0. A test by relabelling counts at least the outcome itself among all of them, C(n+m, n)
    over seeds and 2^n over n pairs; its mirror image too where the two have as many scores, as pairs do. Random
    relabellings, beyond what can be listed, cannot show less than one of them. Fisher's test is one by relabelling
    episodes: at best all of one method succeed and none of the other.
    """
    if test == "fisher":
        # Whole numbers, whose quotient may be smaller than any float, and then is 0.
        return (2 if n == m else 1) / comb(n + m, n) if min(n, m) > 0 else None
    if min(n, m) < 2:
        return None
    if test in T_TESTS:
        return 0.0
    relabellings = 2**n if test in PAIRED else comb(n + m, n)
    if relabellings <= EXACT_RELABELLINGS:
        return min(1.0, (2.0 if n == m else 1.0) / relabellings)
    # Beyond, the rank tests use the normal approximation, which has no smallest value worth a warning.
    return 1.0 / (RANDOM_RELABELLINGS + 1) if test in ("permutation", "paired-permutation") else 0.0


def can_reach(test: HighlightTest, n: int, m: int, alpha: float, comparisons: int, correction: Correction) -> bool:
    """Whether the best of `comparisons` tests with n and m scores each can come out below alpha when corrected.

    Under Holm its p-value is multiplied by their number. Under Benjamini and Hochberg it is not where all the others
    are as small, so in the best case that correction asks for nothing.
    """
    smallest = smallest_p(test, n, m)
    if smallest is None:
        return False
    return smallest * (comparisons if correction == "holm" else 1) < alpha


MOST = 1000
"""More seeds than this are not counted: such an effect is out of reach."""

BOUND = 0.8
"""Confidence with which the true spread lies below the one that the cautious figures are for."""


@dataclass(frozen=True)
class Design:
    """Requirements of the comparison.

    Attributes:
        effect: difference of two means that must not be missed, in points.
        power: probability of seeing it, if it is there.
        alpha: level of the two-sided test.
        test: its name; the figures are those of Welch's test whatever it is.
        correction: for the number of tasks.
        seeds: per method and task, as planned.
    """

    effect: float
    power: float
    alpha: float
    test: HighlightTest
    correction: Correction
    seeds: int

    def first_step(self, tasks: int) -> float:
        """Level that the smallest of `tasks` p-values must pass when corrected.

        Under Benjamini and Hochberg too, unless other tasks differ as clearly.
        """
        return self.alpha if self.correction == "none" else self.alpha / tasks


@dataclass(frozen=True)
class Figures:
    """Seeds needed and differences detectable, given two spreads.

    Attributes:
        std_first: standard deviation of the first method's scores, in points.
        std_second: of the second's.
        seeds_alone: seeds per method that the effect needs at α; None for more than `MOST`.
        seeds_corrected: at the first step of the correction.
        detectable_alone: difference that the planned seeds show with the planned power at α, in points; None for one
            seed, which shows nothing.
        detectable_corrected: at the first step of the correction.
    """

    std_first: float
    std_second: float
    seeds_alone: int | None
    seeds_corrected: int | None
    detectable_alone: float | None
    detectable_corrected: float | None


@dataclass(frozen=True)
class TaskPlan:
    """One task.

    Attributes:
        first: the pilot's scores of one method.
        second: of the other.
        spreads: 95% intervals of the two true standard deviations, in points; None where a method has one seed.
        pilot: the figures for the pilot's own standard deviations; None likewise: no spread is known.
        cautious: for their upper bounds at confidence `BOUND`.
    """

    first: Summary
    second: Summary
    spreads: tuple[Interval, Interval] | None
    pilot: Figures | None
    cautious: Figures | None


def plan_tasks(pilots: Sequence[tuple[Summary, Summary]], design: Design) -> list[TaskPlan]:
    """The plan of every task, all of which share the correction.

    Raises:
        ValueError: a power or a level is not strictly between 0 and 1, or the effect is not finite.
    """
    check_probability("power", design.power)
    check_probability("alpha", design.alpha)
    return [_plan(first, second, design, design.first_step(len(pilots))) for first, second in pilots]


def can_show(design: Design, tasks: int, starts: int | None = None) -> bool:
    """Whether the chosen test can come out significant at all; `starts`: pairs of a test that pairs start states."""
    n = design.seeds if starts is None else starts
    return can_reach(design.test, n, n, design.alpha, tasks, design.correction)


def std_interval(summary: Summary, level: float = 0.95) -> Interval | None:
    """Interval of the true standard deviation of normal scores, ``s · √((n - 1) / χ²)``; None for a single one.

    Raises:
        ValueError: `level` is not strictly between 0 and 1.
    """
    check_probability("level", level)
    tail = (1.0 - level) / 2.0
    low, high = _std_at(summary, tail), _std_at(summary, 1.0 - tail)
    return None if low is None or high is None else Interval(low, high, level)


def std_bound(summary: Summary, confidence: float = BOUND) -> float | None:
    """Upper bound of the true standard deviation of normal scores at this confidence; None for a single score.

    Raises:
        ValueError: `confidence` is not strictly between 0 and 1.
    """
    check_probability("confidence", confidence)
    return _std_at(summary, confidence)


def _std_at(summary: Summary, confidence: float) -> float | None:
    if summary.std is None:
        return None
    from scipy.stats import chi2

    return summary.std * math.sqrt((summary.n - 1) / float(chi2.isf(confidence, summary.n - 1)))


def _plan(first: Summary, second: Summary, design: Design, corrected_alpha: float) -> TaskPlan:
    spreads = std_interval(first), std_interval(second)
    bounds = std_bound(first), std_bound(second)
    return TaskPlan(
        first,
        second,
        None if spreads[0] is None or spreads[1] is None else (spreads[0], spreads[1]),
        _figures(first.std, second.std, design, corrected_alpha),
        _figures(*bounds, design, corrected_alpha),
    )


def _figures(
    std_first: float | None, std_second: float | None, design: Design, corrected_alpha: float
) -> Figures | None:
    if std_first is None or std_second is None:
        return None

    def needed(alpha: float) -> int | None:
        return seeds_needed_for(design.effect, std_first, std_second, design.power, alpha, MOST)

    def detectable(alpha: float) -> float | None:
        return detectable_difference(std_first, std_second, design.seeds, design.power, alpha)

    return Figures(
        std_first,
        std_second,
        needed(design.alpha),
        needed(corrected_alpha),
        detectable(design.alpha),
        detectable(corrected_alpha),
    )


@dataclass(frozen=True)
class Cost:
    """Cost of the runs that are left.

    Attributes:
        runs: how many runs.
        hours: on all workers together, and no less than the longest run; None where no run is measured.
        unmeasured: runs among them whose time is unknown; `hours` leaves them out.
    """

    runs: int
    hours: float | None
    unmeasured: int


def cost(missing: Sequence[tuple[int, float | None]], workers: int) -> Cost:
    """The cost of cells, each with its number of missing runs and the seconds that one run keeps a worker busy."""
    measured = [(count, seconds) for count, seconds in missing if count and seconds is not None]
    runs = sum(count for count, _ in missing)
    unmeasured = runs - sum(count for count, _ in measured)
    if not measured:
        return Cost(runs, None if runs else 0.0, unmeasured)
    total = sum(count * seconds for count, seconds in measured)
    return Cost(runs, max(total / workers, *(seconds for _, seconds in measured)) / 3600.0, unmeasured)
