"""Tests of whether two methods have the same expected score.

References:
    B. L. Welch, "The generalization of 'Student's' problem when several different population variances are
    involved", Biometrika 34, 1947.
    C. Colas, O. Sigaud, P.-Y. Oudeyer, "How many random seeds? Statistical power analysis in deep
    reinforcement learning experiments", arXiv:1806.08295, 2018: why Welch, and what few seeds can show.
"""

from __future__ import annotations

from collections.abc import Sequence

from lfobench.stats.summary import Summary, summarize


def welch_test(first: Summary, second: Summary) -> float | None:
    """Two-sided p-value of Welch's t-test that two means are equal; variances may differ.

    Two edges are decided here rather than left to 0/0:

    * a side with fewer than two samples has no variance, so the means cannot be tested: None;
    * both standard deviations are 0: the limit of a shrinking spread, 0 for different means and 1 for equal.
    """
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
        equal_var=False,
    )
    return float(result.pvalue)


def welch_test_of_samples(first: Sequence[float], second: Sequence[float]) -> float | None:
    """`welch_test` of two sets of finite samples ``[n]`` and ``[m]``, unpaired."""
    return welch_test(summarize(first), summarize(second))
