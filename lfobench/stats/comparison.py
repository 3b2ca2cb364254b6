"""Two-sided tests of whether two methods score the same on one task.

Unpaired tests compare training seeds, and say something about other seeds. Paired tests compare common start states,
each with its mean over seeds; they say something about other starts of *these* trained policies, and nothing about
other training seeds. Fisher's test compares pooled counts of successful episodes and takes episodes to be independent,
which those of one seed are not (`successes`).

References:
    B. L. Welch, "The generalization of 'Student's' problem when several different population variances are
    involved", Biometrika 34, 1947.
    H. B. Mann, D. R. Whitney, "On a test of whether one of two random variables is stochastically larger than the
    other", Annals of Mathematical Statistics 18, 1947.
    F. Wilcoxon, "Individual comparisons by ranking methods", Biometrics Bulletin 1, 1945.
    C. Colas, O. Sigaud, P.-Y. Oudeyer, "How many random seeds? Statistical power analysis in deep
    reinforcement learning experiments", arXiv:1806.08295, 2018: why Welch, and what few seeds can show.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.statistic import tie
from lfobench.stats.permutation import permutation_test, rank_sum_test, sign_flip_test, signed_rank_test
from lfobench.stats.names import HighlightTest, Test
from lfobench.stats.proportions import fisher_test
from lfobench.stats.sample import Sample, counted
from lfobench.stats.summary import Summary, difference, summarize

PAIRED: frozenset[Test] = frozenset({"paired-t", "wilcoxon", "paired-permutation"})
"""Tests over common start states."""

T_TESTS: frozenset[HighlightTest] = frozenset({"welch", "student", "paired-t"})
"""Tests that estimate a spread, and have none to estimate where scores, or the differences of pairs, are all equal."""

FROM_SUMMARIES: frozenset[Test] = frozenset({"welch", "student"})
"""Tests that need no more than n, mean and standard deviation, as published tables give them."""


def p_value(test: HighlightTest, first: Sample, second: Sample) -> float | None:
    """Two-sided p-value of `test`; None where a side has fewer than two scores, so nothing can be tested.

    Raises:
        ValueError: the test needs scores or counts that a sample lacks, or start states that the two do not share.
    """
    if test == "fisher":
        one_count, two_count = counted(first).pooled, counted(second).pooled
        return fisher_test(one_count.successes, one_count.trials, two_count.successes, two_count.trials)
    if test == "welch":
        return welch_test(first.summary, second.summary)
    if test == "student":
        return student_test(first.summary, second.summary)
    if test in PAIRED:
        one, two = _scores(test, first.starts), _scores(test, second.starts)
        if one.shape != two.shape:
            raise ValueError(f"'{test}' pairs start states, but one side has {one.size} and the other {two.size}.")
        return None if one.size < 2 else _paired(test, one, two)
    one, two = _scores(test, first.seeds), _scores(test, second.seeds)
    if min(one.size, two.size) < 2:
        return None
    return rank_sum_test(one, two) if test == "mann-whitney" else permutation_test(one, two)


def margin(test: HighlightTest, first: Sample, second: Sample) -> float:
    """By how many points the first side leads in its mean score or pooled success rate; 0 where the two are level.

    Raises:
        ValueError: `fisher`, and a sample without counts.
    """
    if test == "fisher":
        return 100.0 * (counted(first).pooled.rate - counted(second).pooled.rate)
    return difference(first.summary, second.summary)


def without_spread(test: HighlightTest, first: Sample, second: Sample) -> bool:
    """Whether a t-test of the two has no estimate of any spread, so that its p, 0 or 1, is a limit."""
    if test not in T_TESTS:
        return False
    if test in PAIRED:
        return len(first.starts) == len(second.starts) > 1 and _differences(first.starts, second.starts).std == 0.0
    return first.summary.std == second.summary.std == 0.0


def welch_test(first: Summary, second: Summary) -> float | None:
    """p-value of Welch's t-test that two means are equal; variances may differ.

    Two edges are decided here rather than left to 0/0:

    * a side with fewer than two samples has no variance, so the means cannot be tested: None;
    * both standard deviations are 0: the limit of a shrinking spread, 0 for different means and 1 for equal.
    """
    return _t_test(first, second, equal_variances=False)


def student_test(first: Summary, second: Summary) -> float | None:
    """p-value of Student's t-test, which takes the two variances to be equal; edges as in `welch_test`."""
    return _t_test(first, second, equal_variances=True)


def _t_test(first: Summary, second: Summary, *, equal_variances: bool) -> float | None:
    if first.std is None or second.std is None:
        return None
    apart = difference(first, second)
    # The test is scale invariant; working in units of the larger spread keeps squares from underflowing.
    unit = max(first.std, second.std)
    if unit == 0.0:
        return 1.0 if apart == 0.0 else 0.0

    # scipy.stats takes most of a second to import, which `lfobench --help` should not pay.
    from scipy.stats import ttest_ind_from_stats

    result = ttest_ind_from_stats(
        apart / unit,
        first.std / unit,
        first.n,
        0.0,
        second.std / unit,
        second.n,
        equal_var=equal_variances,
    )
    return float(result.pvalue)


def _paired(test: Test, first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    if test == "wilcoxon":
        return signed_rank_test(first, second)
    if test == "paired-permutation":
        return sign_flip_test(first, second)
    # Differences that share a mean but no spread: the same limit as in `welch_test`.
    paired = welch_test(_differences(first.tolist(), second.tolist()), Summary(2, 0.0, 0.0))
    assert paired is not None
    return paired


def _differences(first: Sequence[float], second: Sequence[float]) -> Summary:
    """Of pairs ``[K]``, K at least 2; those that are level differ by 0."""
    level = tie(first, second)
    between = [one - two for one, two in zip(first, second, strict=True)]
    return summarize([0.0 if abs(each) <= level else each for each in between], level)


def _scores(test: Test, scores: tuple[float, ...]) -> NDArray[np.float64]:
    if not scores:
        raise ValueError(f"'{test}' needs {'start states' if test in PAIRED else 'every score'}, not a summary.")
    return np.asarray(scores, dtype=np.float64)
