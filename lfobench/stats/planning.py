"""How many seeds a comparison needs, from a pilot: what a number of seeds can show on each task.

A pilot of few seeds knows its own spread badly: from 3 normal scores, the 95% interval of the true standard deviation
reaches from half to six times the pilot's. The pilot's is too small more than half the time, and so are the seeds
planned from it. Planned from an upper 80% confidence bound of the true one, they have the promised power, or more, in
about 80% of pilots.

References:
    R. H. Browne, "On the use of a pilot sample for sample size determination", Statistics in Medicine 14, 1995: the
    upper confidence bound in place of the pilot's standard deviation.
    S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979:
    the smallest of m p-values is held against α / m.
    W. G. Cochran, "The distribution of quadratic forms in a normal system", Proceedings of the Cambridge
    Philosophical Society 30, 1934: (n - 1) s² / σ² of normal samples is χ² with n - 1 degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lfobench.stats.feasibility import can_reach
from lfobench.stats.intervals import Interval, check_probability
from lfobench.stats.names import Correction, HighlightTest
from lfobench.stats.power import detectable_difference, seeds_needed_for
from lfobench.stats.summary import Summary

MOST = 1000
"""More seeds than this are not counted: such an effect is out of reach."""

BOUND = 0.8
"""Confidence with which the true spread lies below the one that the cautious figures are for."""


@dataclass(frozen=True)
class Design:
    """What is asked of the comparison.

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
        """Level that the smallest of `tasks` p-values is held against when corrected.

        Under Benjamini and Hochberg too, unless other tasks differ as clearly.
        """
        return self.alpha if self.correction == "none" else self.alpha / tasks


@dataclass(frozen=True)
class Figures:
    """What two spreads mean for the design.

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
    """What the true standard deviation of normal scores lies below with this confidence; None for a single score.

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
    """What is left to run.

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
