"""What a number of seeds can show: the power of the t-test, and the seeds that an effect needs.

References:
    J. Cohen, "Statistical Power Analysis for the Behavioral Sciences", 1988, chapter 2: effects in units of the
    standard deviation, power from the noncentral t distribution.
    C. Colas, O. Sigaud, P.-Y. Oudeyer, "How many random seeds? Statistical power analysis in deep reinforcement
    learning experiments", arXiv:1806.08295, 2018.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from lfobench.stats.intervals import check_probability, satterthwaite


def power(effect: float, n: int, alpha: float = 0.05) -> float:
    """Probability that the two-sided two-sample t-test rejects, with `n` samples on each side and equal variances.

    `effect` is the difference of the expectations over the common standard deviation (Cohen's d). One sample on
    each side rejects nothing: power 0.

    Raises:
        ValueError: there is no sample, the effect is not finite, or α is not strictly between 0 and 1.
    """
    return power_for(effect, 1.0, 1.0, n, alpha)


def power_for(difference: float, std_first: float, std_second: float, n: int, alpha: float = 0.05) -> float:
    """Power of Welch's two-sided test, with `n` samples on each side and these true standard deviations.

    An approximation: the statistic is taken as noncentral t with the degrees of freedom that Satterthwaite's formula
    gives for the true variances. It is exact for equal ones. Without any spread, every difference is seen.

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
    standard_error, degrees = satterthwaite(std_first, n, std_second, n)
    if standard_error == 0.0:
        return float(difference != 0.0)
    return _rejection(abs(difference) / standard_error, degrees, alpha)


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

    A power that chance alone reaches (no more than α) is had with an effect of 0.

    Raises:
        ValueError: `power` or α is not strictly between 0 and 1.
    """
    check_probability("power", power)
    check_probability("alpha", alpha)
    if n < 2:
        return None
    if power <= alpha:
        return 0.0
    from scipy.optimize import brentq

    degrees = 2.0 * n - 2.0
    high = 1.0
    while _rejection(high, degrees, alpha) < power:
        high *= 2.0
    noncentrality = brentq(lambda value: _rejection(value, degrees, alpha) - power, 0.0, high, xtol=1e-12)
    return float(noncentrality) * math.sqrt(2.0 / n)


def _rejection(noncentrality: float, degrees: float, alpha: float) -> float:
    """Probability that a noncentral t variable exceeds the two-sided critical value, on either side."""
    from scipy.stats import nct, t

    critical = t.isf(alpha / 2.0, degrees)
    # The lower tail as the upper one of the mirrored variable: nct.cdf gives nan far out.
    return float(nct.sf(critical, degrees, noncentrality) + nct.sf(critical, degrees, -noncentrality))


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
