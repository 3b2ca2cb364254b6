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

Vector = NDArray[np.float64]

EXACT_RELABELLINGS = 200_000
"""Up to this many relabellings are all counted: two groups of 10, or 17 pairs."""

RANDOM_RELABELLINGS = 100_000
"""Beyond, this many are drawn, with a fixed seed: the same data give the same p."""

# Sums of the same numbers in another order differ in their last digits; such ties count as ties.
_TIE = 1e-12


def permutation_test(first: Vector, second: Vector) -> float:
    """Two-sided p-value that ``[n]`` and ``[m]`` are exchangeable, by the difference of their means."""
    return _relabelled(np.concatenate([first, second]), len(first))


def rank_sum_test(first: Vector, second: Vector) -> float:
    """Mann and Whitney's two-sided p-value of ``[n]`` against ``[m]``; ties share their mean rank.

    Exact, ties included, while all relabellings can be listed; the normal approximation corrected for ties beyond.
    """
    from scipy.stats import mannwhitneyu, rankdata

    if comb(len(first) + len(second), len(first)) > EXACT_RELABELLINGS:
        both = np.concatenate([first, second])
        return 1.0 if np.ptp(both) == 0 else float(mannwhitneyu(first, second, method="asymptotic").pvalue)
    return _relabelled(rankdata(np.concatenate([first, second])), len(first))


def sign_flip_test(differences: Vector) -> float:
    """Two-sided p-value that paired differences ``[K]`` are symmetric about 0, by their sum."""
    return _flipped(differences)


def signed_rank_test(differences: Vector) -> float:
    """Wilcoxon's two-sided signed-rank p-value of paired differences ``[K]``; pairs that tie are left out.

    Exact, ties included, while all sign patterns can be listed; the normal approximation beyond.
    """
    from scipy.stats import rankdata, wilcoxon

    nonzero = differences[differences != 0]
    if not len(nonzero):
        return 1.0
    if 2 ** len(nonzero) > EXACT_RELABELLINGS:
        return float(wilcoxon(nonzero, method="approx").pvalue)
    return _flipped(np.sign(nonzero) * rankdata(np.abs(nonzero)))


def _relabelled(values: Vector, n: int) -> float:
    # Of the difference of means only the first group's sum varies, about n times the overall mean.
    centred = values - values.mean()
    if comb(len(values), n) <= EXACT_RELABELLINGS:
        sums = centred[_groups(len(values), n)].sum(axis=1)
        return _share(np.abs(sums), abs(centred[:n].sum()), np.abs(centred).max(), 0)
    generator = np.random.default_rng(0)
    orders = np.argsort(generator.random((RANDOM_RELABELLINGS, len(values))), axis=1)[:, :n]
    return _share(np.abs(centred[orders].sum(axis=1)), abs(centred[:n].sum()), np.abs(centred).max(), 1)


def _flipped(differences: Vector) -> float:
    count = len(differences)
    if 2**count <= EXACT_RELABELLINGS:
        signs, extra = _sign_patterns(count), 0
    else:
        signs, extra = np.random.default_rng(0).choice([-1.0, 1.0], size=(RANDOM_RELABELLINGS, count)), 1
    return _share(np.abs(signs @ differences), abs(differences.sum()), np.abs(differences).max(), extra)


def _share(statistics: Vector, observed: float, unit: float, extra: int) -> float:
    """Share of relabellings at least as far out as the observed one, itself counted `extra` times more."""
    if unit == 0.0:
        return 1.0
    return float((np.count_nonzero(statistics >= observed - _TIE * unit) + extra) / (len(statistics) + extra))


@lru_cache(maxsize=8)
def _groups(total: int, n: int) -> NDArray[np.intp]:
    """Members of the first group ``[C(total, n), n]`` in every relabelling."""
    return np.array(list(combinations(range(total), n)), dtype=np.intp)


@lru_cache(maxsize=8)
def _sign_patterns(count: int) -> Vector:
    """All sign patterns ``[2^count, count]``."""
    bits = (np.arange(2**count)[:, None] >> np.arange(count)) & 1
    return np.asarray(1.0 - 2.0 * bits, dtype=np.float64)
