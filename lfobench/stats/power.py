"""What a number of seeds can show: the power of Welch's t-test, and the seeds that an effect needs.

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
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lfobench.stats.intervals import check_probability

_STEP = 0.25
_TAIL = 1e-10
"""Of the quadrature over the ratio of variances: the power is off by less than 1e-8 for any two spreads."""

_NO_OTHER_SIDE = 10.0
"""Noncentrality from which on the test rejects on the wrong side with a probability below 1e-23."""


def power(effect: float, n: int, alpha: float = 0.05) -> float:
    """Probability that Welch's two-sided test rejects, with `n` samples on each side and equal variances.

    `effect` is the difference of the expectations over the common standard deviation (Cohen's d). One sample on
    each side rejects nothing: power 0.

    Raises:
        ValueError: there is no sample, the effect is not finite, or α is not strictly between 0 and 1.
    """
    return power_for(effect, 1.0, 1.0, n, alpha)


def power_for(difference: float, std_first: float, std_second: float, n: int, alpha: float = 0.05) -> float:
    """Power of Welch's two-sided test, with `n` normal samples on each side and these true standard deviations.

    The degrees of freedom that Welch's test estimates depend on the ratio of the two sample variances alone. Given
    that ratio, the statistic times a constant is noncentral t with 2 n - 2 degrees of freedom, since the sum of the
    variances over their expectations is independent of the ratio; the power is the mean over the ratio, a quadrature
    in one dimension. Few samples make it markedly smaller than Student's. Without any spread, every difference is seen.

    Raises:
        ValueError: there is no sample, a number is not finite, a standard deviation is negative, or α is not
            strictly between 0 and 1.
    """
    check_probability("alpha", alpha)
    if n < 1:
        raise ValueError(f"A test needs at least one sample on each side; got {n}.")
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
    if noncentrality < _NO_OTHER_SIDE:
        # The lower tail as the upper one of the mirrored variable: nct.cdf gives nan far out.
        rejected = rejected + nct.sf(critical, 2 * n - 2, -noncentrality)
    return min(1.0, float(weights @ rejected))


def seeds_needed(effect: float, power: float = 0.8, alpha: float = 0.05, most: int = 1000) -> int | None:
    """The fewest seeds per method with which an effect is seen with this power; None if that takes over `most`.

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
    """Nodes and weights for the first side's share of the two sample variances, each over its expectation.

    The share w of `n` normal samples on each side has the density of Beta((n - 1)/2, (n - 1)/2). The trapezoidal rule
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
