"""Confidence intervals of one mean and of the difference of two, from summaries.

References:
    Student, "The probable error of a mean", Biometrika 6, 1908.
    F. E. Satterthwaite, "An approximate distribution of estimates of variance components", Biometrics Bulletin 2,
    1946, equation 17, and B. L. Welch, Biometrika 34, 1947: degrees of freedom when variances differ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from lfobench.stats.summary import Summary, difference


@dataclass(frozen=True)
class Interval:
    """A confidence interval, ends included, in the unit of the estimate.

    Attributes:
        low: its lower end.
        high: its upper end.
        level: its nominal coverage, between 0 and 1.
    """

    low: float
    high: float
    level: float


@dataclass(frozen=True)
class Estimate:
    """A number with its uncertainty.

    Attributes:
        value: the point estimate.
        interval: around it; None where the samples carry no information about their spread.
    """

    value: float
    interval: Interval | None


def check_probability(name: str, value: float) -> None:
    """Refuses a level, a power or a significance level that is not strictly between 0 and 1 with a ValueError."""
    if not 0.0 < value < 1.0:
        raise ValueError(f"{name} must lie strictly between 0 and 1; got {value}.")


def t_interval(summary: Summary, level: float = 0.95) -> Interval | None:
    """Student's interval of a mean: ``mean ± t · std / √n`` with n - 1 degrees of freedom.

    None for a single sample, which has no spread. A spread of 0 gives a point.

    Raises:
        ValueError: `level` is not strictly between 0 and 1.
    """
    check_probability("level", level)
    if summary.std is None:
        return None
    standard_error = summary.std / math.sqrt(summary.n)
    return around(summary.mean, standard_error, summary.n - 1, level)


def welch_interval(first: Summary, second: Summary, level: float = 0.95) -> Interval | None:
    """Welch's interval of ``first.mean - second.mean``, 0 where they are level; the variances may differ.

    The interval at level 1 - α excludes 0 exactly when Welch's two-sided test has p < α. None when a side has
    fewer than two samples. A spread of 0 on both sides gives a point.

    Raises:
        ValueError: `level` is not strictly between 0 and 1.
    """
    check_probability("level", level)
    if first.std is None or second.std is None:
        return None
    standard_error, degrees = satterthwaite(first.std, first.n, second.std, second.n)
    return around(difference(first, second), standard_error, degrees, level)


def satterthwaite(std_first: float, n_first: int, std_second: float, n_second: int) -> tuple[float, float]:
    """Standard error of a difference of means, and its approximate degrees of freedom.

    With v = std² / n of each side: √(v₁ + v₂) and (v₁ + v₂)² / (v₁² / (n₁ - 1) + v₂² / (n₂ - 1)). Both sides need
    two samples. Without any spread the degrees of freedom have no meaning, and are those of equal variances.
    """
    # Working in units of the larger spread keeps the fourth powers from underflowing.
    unit = max(std_first, std_second)
    if unit == 0.0:
        return 0.0, float(n_first + n_second - 2)
    variance_first = (std_first / unit) ** 2 / n_first
    variance_second = (std_second / unit) ** 2 / n_second
    total = variance_first + variance_second
    degrees = total**2 / (variance_first**2 / (n_first - 1) + variance_second**2 / (n_second - 1))
    return unit * math.sqrt(total), degrees


def around(centre: float, standard_error: float, degrees: float, level: float) -> Interval:
    """The interval ``centre ± t · standard_error``, t the two-sided quantile with these degrees of freedom."""
    if standard_error == 0.0:
        return Interval(centre, centre, level)
    from scipy.stats import t

    half_width = float(t.isf((1.0 - level) / 2.0, degrees)) * standard_error
    return Interval(centre - half_width, centre + half_width, level)
