"""Episodes that succeeded: one method's on one task, pooled over training seeds, and whether pooling is fair.

Episodes of one seed share its policy. Where policies differ from seed to seed, pooled episodes are not independent, and
what takes them to be (Wilson's interval, Fisher's test) promises too much.

References:
    J. N. K. Rao, A. J. Scott, "A simple method for the analysis of clustered binary data", Biometrics 48, 1992: the
    design effect, by which the variance of a proportion of clustered trials exceeds the binomial one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lfobench.stats.intervals import Interval, check_probability


def wilson_interval(successes: int, trials: int, level: float = 0.95) -> Interval:
    """Wilson's score interval of a success rate, between 0 and 1; it always contains ``successes / trials``.

    Raises:
        ValueError: there is no trial, there are not between 0 and `trials` successes, or `level` is not strictly
            between 0 and 1.
    """
    check_probability("level", level)
    check_count(successes, trials)
    from scipy.stats import norm

    z = float(norm.isf((1.0 - level) / 2.0))
    rate = successes / trials
    scale = 1.0 + z**2 / trials
    centre = (rate + z**2 / (2.0 * trials)) / scale
    half_width = z / scale * math.sqrt(rate * (1.0 - rate) / trials + z**2 / (4.0 * trials**2))
    # Rounding would leave the ends of all failures and of all successes a little off 0 and 1.
    low = 0.0 if successes == 0 else centre - half_width
    high = 1.0 if successes == trials else centre + half_width
    return Interval(low, high, level)


def newcombe_interval(
    successes_a: int, trials_a: int, successes_b: int, trials_b: int, level: float = 0.95
) -> Interval:
    """Newcombe's hybrid score interval of the first success rate minus the second, between -1 and 1.

    Raises:
        ValueError: as `wilson_interval`.
    """
    one, two = wilson_interval(successes_a, trials_a, level), wilson_interval(successes_b, trials_b, level)
    rate_a, rate_b = successes_a / trials_a, successes_b / trials_b
    low = math.hypot(rate_a - one.low, two.high - rate_b)
    high = math.hypot(one.high - rate_a, rate_b - two.low)
    return Interval(rate_a - rate_b - low, rate_a - rate_b + high, level)


def fisher_test(successes_a: int, trials_a: int, successes_b: int, trials_b: int) -> float:
    """Two-sided p-value of Fisher's exact test that two success rates are equal.

    It conditions on the total number of successes, which makes it conservative; see `boschloo_test`.

    Raises:
        ValueError: a method has no trial, or not between 0 and its trials successes.
    """
    from scipy.stats import fisher_exact

    return float(fisher_exact(_table(successes_a, trials_a, successes_b, trials_b)).pvalue)


def boschloo_test(successes_a: int, trials_a: int, successes_b: int, trials_b: int) -> float:
    """Two-sided p-value of Boschloo's exact test that two success rates are equal, twice the smaller one-sided one.

    Unconditional, so one-sided it is at least as powerful as Fisher's.

    Raises:
        ValueError: a method has no trial, or not between 0 and its trials successes.
    """
    from scipy.stats import boschloo_exact

    return float(boschloo_exact(_table(successes_a, trials_a, successes_b, trials_b)).pvalue)


def _table(successes_a: int, trials_a: int, successes_b: int, trials_b: int) -> NDArray[np.int64]:
    """Successes over failures, a column per method."""
    check_count(successes_a, trials_a)
    check_count(successes_b, trials_b)
    return np.array([[successes_a, successes_b], [trials_a - successes_a, trials_b - successes_b]])


def check_count(successes: int, trials: int) -> None:
    """Refuses, with a ValueError, a success rate without a trial or with more successes than trials."""
    if int(successes) != successes or int(trials) != trials or trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"A success rate needs whole counts of at least one trial; got {successes} of {trials}.")


@dataclass(frozen=True)
class Count:
    """Successes out of at least one trial.

    Raises:
        ValueError: there is no trial, or there are not between 0 and `trials` successes.
    """

    successes: int
    trials: int

    def __post_init__(self) -> None:
        check_count(self.successes, self.trials)

    def __add__(self, other: Count) -> Count:
        return Count(self.successes + other.successes, self.trials + other.trials)

    @property
    def rate(self) -> float:
        """Fraction of trials that succeeded."""
        return self.successes / self.trials


@dataclass(frozen=True)
class Successes:
    """The episodes of one cell.

    Attributes:
        fixed: those from the fixed test starts, which every evaluation shares.
        pooled: those and the final evaluation's, from further starts.
        seeds: `pooled` by training seed ``[n]``; empty where only the total was published.
    """

    fixed: Count
    pooled: Count
    seeds: tuple[Count, ...] = ()

    @cached_property
    def interval(self) -> Interval:
        """Wilson's 95 % interval of the pooled success rate, between 0 and 1."""
        return wilson_interval(self.pooled.successes, self.pooled.trials)

    @cached_property
    def inflation(self) -> float | None:
        """The variance inflation of the pooled success rate by seeds; None where it cannot be known."""
        return variance_inflation(self.seeds)


def pool(fixed: Sequence[Count], seeds: Sequence[Count]) -> Successes:
    """The successes of a cell from its seeds ``[n]``: from the fixed starts alone, and from all starts.

    Raises:
        ValueError: there is no seed, or the two differ in their numbers of seeds.
    """
    if not seeds or len(fixed) != len(seeds):
        raise ValueError(f"Pooling needs the same seeds twice, at least one; got {len(fixed)} and {len(seeds)}.")
    return Successes(_sum(fixed), _sum(seeds), tuple(seeds))


def variance_inflation(seeds: Sequence[Count]) -> float | None:
    """Rao and Scott's design effect of m clusters ``[m]``, here training seeds with their episodes.

    With x successes in n trials of a seed, N = Σ n and p = Σ x / N, the variance of p between seeds is
    ``v = m / (m - 1) · Σ (x - n p)² / N²``, and the design effect is ``v`` over the binomial ``p (1 - p) / N`` (Rao and
    Scott 1992, section 2). It is about 1 where seeds differ as chance alone makes them differ.

    None for fewer than two seeds, and where no episode or every one succeeded, so that there is no variance at all.
    """
    if len(seeds) < 2:
        return None
    total = _sum(seeds)
    p = total.rate
    if p in (0.0, 1.0):
        return None
    squares = sum((seed.successes - seed.trials * p) ** 2 for seed in seeds)
    between = len(seeds) / (len(seeds) - 1) * squares / total.trials**2
    return between * total.trials / (p * (1.0 - p))


def _sum(counts: Sequence[Count]) -> Count:
    return Count(sum(count.successes for count in counts), sum(count.trials for count in counts))
