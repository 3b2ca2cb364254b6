"""Success rates: an interval of one and tests of two, from counts of successes in independent trials.

Episodes of one trained policy share its seed, so pooled over seeds they are not independent: intervals are then too
narrow and p-values too small; `successes.variance_inflation` says by how much.

References:
    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", Journal of the American
    Statistical Association 22, 1927.
    R. G. Newcombe, "Interval estimation for the difference between independent proportions: comparison of eleven
    methods", Statistics in Medicine 17, 1998: method 10, which combines two of Wilson's intervals.
    R. A. Fisher, "The logic of inductive inference", Journal of the Royal Statistical Society 98, 1935.
    R. D. Boschloo, "Raised conditional level of significance for the 2 × 2-table when testing the equality of two
    probabilities", Statistica Neerlandica 24, 1970.
"""

from __future__ import annotations

import math

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
        ValueError: a side has no trial, or not between 0 and its trials successes.
    """
    from scipy.stats import fisher_exact

    return float(fisher_exact(_table(successes_a, trials_a, successes_b, trials_b)).pvalue)


def boschloo_test(successes_a: int, trials_a: int, successes_b: int, trials_b: int) -> float:
    """Two-sided p-value of Boschloo's exact test that two success rates are equal, twice the smaller one-sided one.

    Unconditional, so one-sided it is at least as powerful as Fisher's.

    Raises:
        ValueError: a side has no trial, or not between 0 and its trials successes.
    """
    from scipy.stats import boschloo_exact

    return float(boschloo_exact(_table(successes_a, trials_a, successes_b, trials_b)).pvalue)


def _table(successes_a: int, trials_a: int, successes_b: int, trials_b: int) -> NDArray[np.int64]:
    """Successes over failures, one side a column."""
    check_count(successes_a, trials_a)
    check_count(successes_b, trials_b)
    return np.array([[successes_a, successes_b], [trials_a - successes_a, trials_b - successes_b]])


def check_count(successes: int, trials: int) -> None:
    """Refuses, with a ValueError, a success rate without a trial or with more successes than trials."""
    if int(successes) != successes or int(trials) != trials or trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"A success rate needs whole counts of at least one trial; got {successes} of {trials}.")
