"""Tests by relabelling: exact while every relabelling can be listed, seeded random relabellings beyond.

References:
    E. J. G. Pitman, "Significance tests which may be applied to samples from any populations", Supplement to the
    Journal of the Royal Statistical Society 4, 1937.
    B. Phipson, G. K. Smyth, "Permutation p-values should never be zero", Statistical Applications in Genetics and
    Molecular Biology 9, 2010: the observed labelling counts as one of the random ones.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.statistic import tie

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
    # the seeds and of the sides either.
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
