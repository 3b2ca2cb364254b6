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

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

from lfobench.score import tie
from lfobench.stats.intervals import Summary, difference, satterthwaite, summarize
from lfobench.stats.options import HighlightTest, Test
from lfobench.stats.successes import Successes, fisher_test


@dataclass(frozen=True)
class Sample:
    """The scores behind one cell.

    Attributes:
        summary: n, mean and standard deviation over training seeds.
        seeds: one score per training seed ``[n]``; empty where only the summary was published.
        starts: one score per common start state ``[K]``, the mean over seeds of that start's episodes; empty where
            episodes are unknown.
        successes: how many episodes succeeded; None where scores are compared.
    """

    summary: Summary
    seeds: tuple[float, ...] = ()
    starts: tuple[float, ...] = ()
    successes: Successes | None = None


def sample_of(seeds: Sequence[float], starts: Sequence[float] = (), successes: Successes | None = None) -> Sample:
    """The sample of finite scores ``[n]``, one per seed, and ``[K]``, one per start.

    Raises:
        ValueError: there is no seed, or a score is not finite.
    """
    if starts:
        summarize(starts)
    return Sample(summarize(seeds), tuple(seeds), tuple(starts), successes)


def counted(sample: Sample) -> Successes:
    """The successes of a sample that must have them.

    Raises:
        ValueError: it has none.
    """
    if sample.successes is None:
        raise ValueError("'fisher' needs to know how every episode ended.")
    return sample.successes


Vector = NDArray[np.float64]

EXACT_RELABELLINGS = 200_000
"""Up to this many relabellings are all counted: two groups of 10, or 17 pairs."""

RANDOM_RELABELLINGS = 100_000
"""Beyond, this many are drawn, with a fixed seed: the same data give the same p."""


def permutation_test(first: Vector, second: Vector) -> float:
    """Two-sided p-value that ``[n]`` and ``[m]`` are exchangeable, by the size of the difference of their means.

    Both tails are counted; SciPy doubles the smaller one, which is the same where n and m are equal.
    """
    return _relabelled(np.concatenate([first, second]), len(first))


def rank_sum_test(first: Vector, second: Vector) -> float:
    """Mann and Whitney's two-sided p-value of ``[n]`` against ``[m]``; ties share their mean rank.

    Exact, ties included, while all relabellings can be listed; the normal approximation corrected for ties beyond.
    """
    from scipy.stats import mannwhitneyu, rankdata

    both = levels(np.concatenate([first, second]), tie(first, second))
    if comb(len(both), len(first)) > EXACT_RELABELLINGS:
        one, two = both[: len(first)], both[len(first) :]
        return 1.0 if np.ptp(both) == 0 else float(mannwhitneyu(one, two, method="asymptotic").pvalue)
    return _relabelled(rankdata(both), len(first))


def sign_flip_test(first: Vector, second: Vector) -> float:
    """Two-sided p-value that the differences of ``[K]`` pairs are symmetric about 0, by their sum."""
    return _flipped(first - second, tie(first, second))


def signed_rank_test(first: Vector, second: Vector) -> float:
    """Wilcoxon's two-sided signed-rank p-value of ``[K]`` pairs; pairs that tie are left out.

    Exact, ties included, while all sign patterns can be listed; the normal approximation beyond.
    """
    from scipy.stats import rankdata, wilcoxon

    differences, apart = first - second, tie(first, second)
    nonzero = differences[np.abs(differences) > apart]
    if not len(nonzero):
        return 1.0
    signed = np.sign(nonzero) * levels(np.abs(nonzero), apart)
    if 2 ** len(nonzero) > EXACT_RELABELLINGS:
        return float(wilcoxon(signed, method="approx").pvalue)
    ranks = np.sign(signed) * rankdata(np.abs(signed))
    return _flipped(ranks, tie(ranks))


def levels(scores: Vector, apart: float) -> Vector:
    """Whole numbers from 1 in the order of scores ``[K]``, equal for neighbours that differ by no more than `apart`."""
    order = np.argsort(scores)
    found = np.empty(len(scores))
    found[order] = 1 + np.cumsum(np.diff(scores[order], prepend=scores[order[0]]) > apart)
    return found


def _relabelled(values: Vector, n: int) -> float:
    # Of the difference of means only the first group's sum varies, about n times the overall mean.
    centred = values - values.mean()
    observed = abs(centred[:n].sum())
    # The second group's sum is the same but for its sign. Sorted, random relabellings do not depend on the order of
    # the seeds and of the two methods either.
    centred, smaller = np.sort(centred), min(n, len(values) - n)
    if comb(len(values), n) <= EXACT_RELABELLINGS:
        sums = centred[_groups(len(values), smaller)].sum(axis=1)
        return _share(np.abs(sums), observed, tie(values), 0)
    generator = np.random.default_rng(0)
    orders = np.argsort(generator.random((RANDOM_RELABELLINGS, len(values))), axis=1)[:, :smaller]
    return _share(np.abs(centred[orders].sum(axis=1)), observed, tie(values), 1)


def _flipped(differences: Vector, apart: float) -> float:
    count = len(differences)
    if 2**count <= EXACT_RELABELLINGS:
        signs, extra = _sign_patterns(count), 0
    else:
        signs, extra = np.random.default_rng(0).choice([-1.0, 1.0], size=(RANDOM_RELABELLINGS, count)), 1
    return _share(np.abs(signs @ differences), abs(differences.sum()), apart, extra)


def _share(statistics: Vector, observed: float, apart: float, extra: int) -> float:
    """Share of relabellings at least as far out as the observed one, itself counted `extra` times more."""
    return float((np.count_nonzero(statistics >= observed - apart) + extra) / (len(statistics) + extra))


@lru_cache(maxsize=8)
def _groups(total: int, n: int) -> NDArray[np.intp]:
    """Members of the first group ``[C(total, n), n]`` in every relabelling."""
    return np.array(list(combinations(range(total), n)), dtype=np.intp)


@lru_cache(maxsize=8)
def _sign_patterns(count: int) -> Vector:
    """All sign patterns ``[2^count, count]``."""
    bits = (np.arange(2**count)[:, None] >> np.arange(count)) & 1
    return np.asarray(1.0 - 2.0 * bits, dtype=np.float64)


PAIRED: frozenset[Test] = frozenset({"paired-t", "wilcoxon", "paired-permutation"})
"""Tests over common start states."""

T_TESTS: frozenset[HighlightTest] = frozenset({"welch", "student", "paired-t"})
"""Tests that estimate a spread, and have none to estimate where scores, or the differences of pairs, are all equal."""

FROM_SUMMARIES: frozenset[Test] = frozenset({"welch", "student"})
"""Tests that need no more than n, mean and standard deviation, as published tables give them."""


@lru_cache(maxsize=65_536)
def p_value(test: HighlightTest, first: Sample, second: Sample) -> float | None:
    """Two-sided p-value of `test`; None where either sample has fewer than two scores.

    Remembered, because a page decides one table under many rules, and a relabelling test takes a while.

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
            raise ValueError(f"'{test}' pairs start states, but one method has {one.size} and the other {two.size}.")
        return None if one.size < 2 else _paired(test, one, two)
    one, two = _scores(test, first.seeds), _scores(test, second.seeds)
    if min(one.size, two.size) < 2:
        return None
    return rank_sum_test(one, two) if test == "mann-whitney" else permutation_test(one, two)


def margin(test: HighlightTest, first: Sample, second: Sample) -> float:
    """Difference of the mean scores or pooled success rates in points, first minus second; 0 where the two are level.

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

    * fewer than two samples have no variance, so the means cannot be tested: None;
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

    first_std, second_std = first.std / unit, second.std / unit
    if equal_variances:
        degrees = float(first.n + second.n - 2)
        pooled = ((first.n - 1) * first_std**2 + (second.n - 1) * second_std**2) / degrees
        standard_error = math.sqrt(pooled * (1.0 / first.n + 1.0 / second.n))
    else:
        standard_error, degrees = satterthwaite(first_std, first.n, second_std, second.n)

    # The p-value of scipy.stats.ttest_ind_from_stats; scipy.stats takes most of a second to import.
    from scipy.special import stdtr

    return 2.0 * float(stdtr(degrees, -abs(apart / unit) / standard_error))


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
    """Summary of the differences of pairs ``[K]``, K at least 2; pairs that are level differ by 0."""
    level = tie(first, second)
    between = [one - two for one, two in zip(first, second, strict=True)]
    return summarize([0.0 if abs(each) <= level else each for each in between], level)


def _scores(test: Test, scores: tuple[float, ...]) -> NDArray[np.float64]:
    if not scores:
        raise ValueError(f"'{test}' needs {'start states' if test in PAIRED else 'every score'}, not a summary.")
    return np.asarray(scores, dtype=np.float64)
