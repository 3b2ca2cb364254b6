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

import numpy as np
from numpy.typing import NDArray

from lfobench.stats import permutation
from lfobench.stats.names import HighlightTest, Test
from lfobench.stats.proportions import fisher_test
from lfobench.stats.sample import Sample, counted
from lfobench.stats.summary import Summary, summarize

PAIRED: frozenset[Test] = frozenset({"paired-t", "wilcoxon", "paired-permutation"})
"""Tests over common start states."""

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
    return permutation.rank_sum_test(one, two) if test == "mann-whitney" else permutation.permutation_test(one, two)


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
    difference = first.mean - second.mean
    # The test is scale invariant; working in units of the larger spread keeps squares from underflowing.
    unit = max(first.std, second.std)
    if unit == 0.0:
        return 1.0 if difference == 0.0 else 0.0

    # scipy.stats takes most of a second to import, which `lfobench --help` should not pay.
    from scipy.stats import ttest_ind_from_stats

    result = ttest_ind_from_stats(
        difference / unit,
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
        return permutation.signed_rank_test(first, second)
    if test == "paired-permutation":
        return permutation.sign_flip_test(first, second)
    # Differences that share a mean but no spread: the same limit as in `welch_test`.
    summary = summarize((first - second).tolist())
    paired = welch_test(summary, Summary(2, 0.0, 0.0))
    assert paired is not None
    return paired


def _scores(test: Test, scores: tuple[float, ...]) -> NDArray[np.float64]:
    if not scores:
        raise ValueError(f"'{test}' needs {'start states' if test in PAIRED else 'every score'}, not a summary.")
    return np.asarray(scores, dtype=np.float64)
