"""Average ranks of methods over tasks, and which of them differ significantly.

References:
    M. Friedman, "The use of ranks to avoid the assumption of normality implicit in the analysis of variance",
    Journal of the American Statistical Association 32, 1937.
    P. B. Nemenyi, "Distribution-free multiple comparisons", PhD thesis, Princeton University, 1963.
    J. Demšar, "Statistical comparisons of classifiers over multiple data sets", Journal of Machine Learning Research
    7, 2006, section 3.2.2: the critical difference, table 5(a), and its diagram.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfobench.score import tie
from lfobench.stats.intervals import check_probability
from lfobench.stats.tests import levels


def average_ranks(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean rank of each method ``[methods]`` over the tasks of scores ``[tasks, methods]``.

    The highest score of a task has rank 1; scores that are level share the mean of their ranks.

    Raises:
        ValueError: there is no task or no method, or a score is not finite.
    """
    _check(scores)
    from scipy.stats import rankdata

    return np.asarray(rankdata(-_levels(scores), axis=1).mean(axis=0))


def friedman_test(scores: NDArray[np.float64]) -> float | None:
    """p-value of Friedman's test that all methods of scores ``[tasks, methods]`` rank alike, by the χ² limit.

    None for fewer than 3 methods or 2 tasks, where the limit says nothing. 1 when all methods tie on every task.

    Raises:
        ValueError: there is no task or no method, or a score is not finite.
    """
    _check(scores)
    tasks, methods = scores.shape
    if methods < 3 or tasks < 2:
        return None
    scores = _levels(scores)
    if (scores == scores[:, :1]).all():
        return 1.0
    from scipy.stats import friedmanchisquare

    return float(friedmanchisquare(*scores.T).pvalue)


def critical_difference(methods: int, tasks: int, alpha: float = 0.05) -> float:
    """Difference of two average ranks that is significant by Nemenyi's test, at level α for all pairs.

    ``q_α √(k (k + 1) / (6 N))`` for k methods on N tasks, q_α the upper quantile of the Studentized range of k
    variables with infinite degrees of freedom, over √2 (Demšar 2006, equation 6).

    Raises:
        ValueError: there are fewer than 2 methods or no task, or α is not strictly between 0 and 1.
    """
    check_probability("alpha", alpha)
    if methods < 2 or tasks < 1:
        raise ValueError(f"A critical difference needs two methods and a task; got {methods} and {tasks}.")
    from scipy.stats import studentized_range

    quantile = float(studentized_range.ppf(1.0 - alpha, methods, np.inf)) / math.sqrt(2.0)
    return quantile * math.sqrt(methods * (methods + 1) / (6.0 * tasks))


def groups(ranks: Sequence[float] | NDArray[np.float64], difference: float) -> list[tuple[int, ...]]:
    """The bars of a critical-difference diagram: maximal sets of methods that do not differ significantly.

    Each holds the indices into average ranks ``[methods]``, best first, of two or more methods whose ranks differ by
    less than `difference`, and lies in no larger such set.
    """
    order = sorted(range(len(ranks)), key=lambda method: ranks[method])
    found: list[tuple[int, ...]] = []
    reached = 0
    for first, best in enumerate(order):
        end = first
        while end < len(order) and ranks[order[end]] - ranks[best] < difference:
            end += 1
        # A set that ends no further than an earlier one lies inside it.
        if end > max(reached, first + 1):
            found.append(tuple(order[first:end]))
            reached = end
    return found


def _levels(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """The scores ``[tasks, methods]`` by their order on each task, equal where they differ by rounding alone."""
    return np.array([levels(task, tie(task)) for task in scores])


def _check(scores: NDArray[np.float64]) -> None:
    if scores.ndim != 2 or scores.size == 0 or not np.isfinite(scores).all():
        raise ValueError(f"Ranks need finite scores [tasks, methods]; got shape {scores.shape}.")
