"""Confidence intervals of one mean and of the difference of two, from summaries.

References:
    Student, "The probable error of a mean", Biometrika 6, 1908.
    F. E. Satterthwaite, "An approximate distribution of estimates of variance components", Biometrics Bulletin 2,
    1946, equation 17, and B. L. Welch, Biometrika 34, 1947: degrees of freedom when variances differ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lfobench.score import mean, tie
from lfobench.stats.options import Agreement


@dataclass(frozen=True)
class Summary:
    """Mean and spread of `n` samples, in the samples' unit.

    Attributes:
        n: number of samples, at least 1.
        mean: their arithmetic mean.
        std: their sample standard deviation (ddof 1), or None for a single sample. One sample carries no
            information about spread, and a printed "± 0" would claim that it does.
    """

    n: int
    mean: float
    std: float | None


def difference(first: Summary, second: Summary) -> float:
    """Mean of the first minus mean of the second; 0 where they are level."""
    between = first.mean - second.mean
    return 0.0 if abs(between) <= tie((first.mean, second.mean, first.std or 0.0, second.std or 0.0)) else between


def summarize(samples: Sequence[float], level: float | None = None) -> Summary:
    """The summary of finite samples ``[n]``, one per seed, from exact sums: their order plays no part.

    Samples no further apart than `level`, by default their own `tie`, have no spread.

    Raises:
        ValueError: there is no sample, one is not finite, or they are too far apart for floating-point numbers.
    """
    if not samples or not all(map(math.isfinite, samples)):
        raise ValueError(f"A summary needs at least one sample, all finite; got {list(samples)}.")
    centre = mean(samples)
    if len(samples) == 1:
        return Summary(1, centre, None)
    if max(samples) - min(samples) <= (tie(samples) if level is None else level):
        return Summary(len(samples), centre, 0.0)
    deviations = [sample - centre for sample in samples]
    # In units of the largest, squares neither overflow nor vanish.
    unit = max(map(abs, deviations))
    std = unit * math.sqrt(math.fsum((each / unit) ** 2 for each in deviations) / (len(samples) - 1))
    if not math.isfinite(std):
        raise ValueError(f"The samples lie too far apart to be summarized: {min(samples):g} to {max(samples):g}.")
    return Summary(len(samples), centre, std)


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

    The interval at level 1 - α excludes 0 exactly when Welch's two-sided test has p < α. None when either has
    fewer than two samples. Two spreads of 0 give a point.

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

    With v = std² / n of each: √(v₁ + v₂) and (v₁ + v₂)² / (v₁² / (n₁ - 1) + v₂² / (n₂ - 1)). Both need
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
    # scipy.stats has the same quantile as t.isf, and takes four times as long to import.
    from scipy.special import stdtrit

    half_width = -float(stdtrit(degrees, (1.0 - level) / 2.0)) * standard_error
    return Interval(centre - half_width, centre + half_width, level)


@dataclass(frozen=True)
class EquivalenceResult:
    """Whether two means agree within a margin.

    Attributes:
        difference: first mean minus second.
        interval: of the difference at level 1 - 2α, which lies inside the margin exactly when p < α; None when
            either has fewer than two samples.
        p: the larger p-value of the two one-sided tests, or None as above. Small means equivalent.
        agreement: `matches`: the difference is shown to be smaller than the margin; `differs`: the means are shown
            to differ, and not to match; `undecided`: neither is shown.
    """

    difference: float
    interval: Interval | None
    p: float | None
    agreement: Agreement


def equivalence_test(first: Summary, second: Summary, margin: float, alpha: float = 0.05) -> EquivalenceResult:
    """Tests that two means differ by less than `margin`, in the samples' unit; variances may differ.

    A difference that is significant and yet shown to be smaller than the margin `matches`: the margin says which
    differences matter. Where both have no spread the limit of a shrinking spread decides: p is 0
    inside the margin, 1 outside, 1/2 on it.

    Raises:
        ValueError: the margin is not positive and finite, or α is not between 0 and 1/2.
    """
    check_probability("2 alpha", 2.0 * alpha)
    if not 0.0 < margin < math.inf:
        raise ValueError(f"A margin is positive and finite; got {margin}.")
    apart = difference(first, second)
    interval = welch_interval(first, second, 1.0 - alpha)
    if first.std is None or second.std is None or interval is None:
        return EquivalenceResult(apart, None, None, "undecided")
    standard_error, degrees = satterthwaite(first.std, first.n, second.std, second.n)
    p = _larger_p(margin - abs(apart), standard_error, degrees)
    agreement: Agreement = "undecided"
    if p < alpha:
        agreement = "matches"
    elif not interval.low <= 0.0 <= interval.high:
        agreement = "differs"
    return EquivalenceResult(apart, around(apart, standard_error, degrees, 1.0 - 2.0 * alpha), p, agreement)


def _larger_p(room: float, standard_error: float, degrees: float) -> float:
    """The p-value of the one-sided test whose bound is nearer, `room` away from the difference."""
    if standard_error == 0.0:
        return 0.5 if room == 0.0 else float(room < 0.0)
    from scipy.special import stdtr

    return float(stdtr(degrees, -room / standard_error))
