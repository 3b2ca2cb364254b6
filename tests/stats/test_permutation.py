"""Tests by relabelling against SciPy and against loops over every relabelling in exact arithmetic."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from fractions import Fraction
from itertools import combinations, product
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from lfobench.stats.tests import (
    EXACT_RELABELLINGS,
    RANDOM_RELABELLINGS,
    permutation_test,
    rank_sum_test,
    sign_flip_test,
    signed_rank_test,
)

# Whole numbers: the references below count ties without any rounding.
values = st.integers(-30, 130)
samples = st.lists(values, min_size=2, max_size=5)
pairs = st.lists(st.tuples(values, values), min_size=2, max_size=7)
distinct = st.lists(values, min_size=5, max_size=10, unique=True)


def array(numbers: list[int]) -> np.ndarray:
    return np.array(numbers, dtype=np.float64)


def split(of_pairs: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    return array([one for one, _ in of_pairs]), array([two for _, two in of_pairs])


def ranks(numbers: list[int]) -> list[Fraction]:
    """Mean ranks: one more than the smaller ones, and half of the others that are equal."""
    return [
        sum(other < number for other in numbers) + Fraction(sum(other == number for other in numbers) + 1, 2)
        for number in numbers
    ]


def over_relabellings(numbers: list[int] | list[Fraction], n: int) -> Fraction:
    """Share of choices of n whose mean is as far from the others' as that of the first n."""

    def distance(chosen: tuple[int, ...]) -> Fraction:
        inside = [Fraction(numbers[index]) for index in chosen]
        outside = [Fraction(number) for index, number in enumerate(numbers) if index not in chosen]
        return abs(sum(inside) / len(inside) - sum(outside) / len(outside))

    observed = distance(tuple(range(n)))
    found = [distance(chosen) >= observed for chosen in combinations(range(len(numbers)), n)]
    return Fraction(sum(found), len(found))


def over_signs(differences: list[int] | list[Fraction]) -> Fraction:
    """Share of sign patterns whose sum is as far from 0 as the observed one."""
    observed = abs(sum(differences))
    sums = [sum(map(operator.mul, signs, differences)) for signs in product((1, -1), repeat=len(differences))]
    return Fraction(sum(abs(total) >= observed for total in sums), len(sums))


@settings(max_examples=40)
@given(samples, samples)
def test_permutation_counts_every_relabelling(first: list[int], second: list[int]) -> None:
    expected = float(over_relabellings(first + second, len(first)))
    assert permutation_test(array(first), array(second)) == pytest.approx(expected, abs=1e-10)


@settings(max_examples=15)
@given(samples, samples)
def test_permutation_agrees_with_scipy(first: list[int], second: list[int]) -> None:
    """Its two-sided p doubles the smaller tail, which is this one where both sides have as many scores."""
    size = min(len(first), len(second))
    one, two = array(first[:size]), array(second[:size])
    expected = stats.permutation_test(
        (one, two), lambda x, y, axis: x.mean(axis) - y.mean(axis), vectorized=True, n_resamples=np.inf
    ).pvalue
    assert permutation_test(one, two) == pytest.approx(expected, abs=1e-10)


@settings(max_examples=40)
@given(distinct)
def test_rank_sum_agrees_with_scipy_where_nothing_ties(numbers: list[int]) -> None:
    first, second = array(numbers[:3]), array(numbers[3:])
    expected = stats.mannwhitneyu(first, second, method="exact").pvalue
    assert rank_sum_test(first, second) == pytest.approx(expected, abs=1e-10)


@settings(max_examples=40)
@given(st.lists(st.integers(0, 3), min_size=2, max_size=5), st.lists(st.integers(0, 3), min_size=2, max_size=5))
def test_rank_sum_counts_every_relabelling_where_some_tie(first: list[int], second: list[int]) -> None:
    expected = float(over_relabellings(ranks(first + second), len(first)))
    assert rank_sum_test(array(first), array(second)) == pytest.approx(expected, abs=1e-10)


@settings(max_examples=40)
@given(pairs)
def test_sign_flips_count_every_pattern(of_pairs: list[tuple[int, int]]) -> None:
    expected = float(over_signs([one - two for one, two in of_pairs]))
    assert sign_flip_test(*split(of_pairs)) == pytest.approx(expected, abs=1e-10)


@settings(max_examples=40)
@given(st.permutations(range(1, 9)), st.integers(0, 255))
def test_signed_rank_agrees_with_scipy_where_nothing_ties(magnitudes: list[int], signs: int) -> None:
    differences = [magnitude * (1 if signs >> bit & 1 else -1) for bit, magnitude in enumerate(magnitudes)]
    expected = stats.wilcoxon(array(differences), method="exact").pvalue
    assert signed_rank_test(array(differences), np.zeros(8)) == pytest.approx(expected, abs=1e-10)


@settings(max_examples=40)
@given(st.lists(st.integers(-3, 3), min_size=2, max_size=7))
def test_signed_rank_counts_every_pattern_where_some_tie(differences: list[int]) -> None:
    nonzero = [difference for difference in differences if difference]
    signed = [
        rank if difference > 0 else -rank
        for difference, rank in zip(nonzero, ranks([abs(difference) for difference in nonzero]), strict=True)
    ]
    expected = float(over_signs(signed)) if signed else 1.0
    assert signed_rank_test(array(differences), np.zeros(len(differences))) == pytest.approx(expected, abs=1e-10)


RelabellingTest: TypeAlias = Callable[[np.ndarray, np.ndarray], float]
TESTS = (permutation_test, rank_sum_test, sign_flip_test, signed_rank_test)


@pytest.mark.parametrize("test", TESTS)
@given(of_pairs=pairs)
@settings(max_examples=25)
def test_scores_that_lie_close_together_far_from_zero_tie_as_whole_numbers_do(
    test: RelabellingTest, of_pairs: list[tuple[int, int]]
) -> None:
    """Saturated methods score 100.01 and 100.02, and none of these is exactly a binary fraction."""
    whole, saturated = split(of_pairs), split([(100_000 + one, 100_000 + two) for one, two in of_pairs])
    expected = test(*whole)
    assert test(*(side / 1000 for side in saturated)) == expected


@pytest.mark.parametrize("test", TESTS)
def test_equal_scores_are_not_told_apart(test: RelabellingTest) -> None:
    for value, count in ((0.0, 4), (100 / 3, 4), (0.1, 30)):
        assert test(np.full(count, value), np.full(count, value)) == 1.0


# --- beyond what can be listed ---------------------------------------------------------------------------------------

# Of a share estimated from random relabellings; four of its standard errors are not left by chance.
RANDOM_ERROR = 4 * math.sqrt(0.25 / RANDOM_RELABELLINGS)


def far_apart(n: int, m: int, shift: float) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    return random.normal(shift, 1.0, n), random.normal(0.0, 1.0, m)


def test_the_limit_is_two_groups_of_ten_and_seventeen_pairs() -> None:
    assert math.comb(20, 10) <= EXACT_RELABELLINGS < math.comb(21, 10)
    assert 2**17 <= EXACT_RELABELLINGS < 2**18


def test_random_relabellings_come_close_to_the_whole_distribution() -> None:
    """22 whole numbers: the distribution of the first group's sum by dynamic programming, C(22, 11) relabellings."""
    random = np.random.default_rng(1)
    numbers = [int(number) for number in random.integers(0, 40, 22)]
    ways = {(0, 0): 1}
    for number in numbers:
        for (count, total), found in list(ways.items()):
            key = (count + 1, total + number)
            ways[key] = ways.get(key, 0) + found
    observed = abs(2 * sum(numbers[:11]) - sum(numbers))
    extreme = sum(
        found for (count, total), found in ways.items() if count == 11 and abs(2 * total - sum(numbers)) >= observed
    )
    expected = extreme / math.comb(22, 11)
    p = permutation_test(array(numbers[:11]), array(numbers[11:]))
    assert p == pytest.approx(expected, abs=RANDOM_ERROR)
    assert 0.01 < expected < 0.99


def test_random_sign_flips_come_close_to_the_whole_distribution() -> None:
    random = np.random.default_rng(2)
    differences = [int(number) for number in random.integers(-20, 30, 24)]
    ways = {0: 1}
    for difference in differences:
        added: dict[int, int] = {}
        for total, found in ways.items():
            for signed in (total + difference, total - difference):
                added[signed] = added.get(signed, 0) + found
        ways = added
    expected = sum(found for total, found in ways.items() if abs(total) >= abs(sum(differences))) / 2**24
    p = sign_flip_test(array(differences), np.zeros(24))
    assert p == pytest.approx(expected, abs=RANDOM_ERROR)
    assert 0.01 < expected < 0.99


def test_random_relabellings_depend_on_the_scores_alone() -> None:
    first, second = far_apart(12, 15, 0.6)
    p = permutation_test(first, second)
    assert permutation_test(first, second) == p
    assert permutation_test(second, first) == p
    assert permutation_test(first[::-1], second[::-1]) == p
    assert 0.0 < p < 1.0
    one, two = far_apart(20, 20, 0.3)
    assert sign_flip_test(one, two) == sign_flip_test(one, two) == sign_flip_test(two, one)


def test_random_relabellings_never_give_zero() -> None:
    """The observed labelling counts as one of them (Phipson and Smyth 2010)."""
    least = 1 / (RANDOM_RELABELLINGS + 1)
    assert permutation_test(*far_apart(12, 12, 1000.0)) == pytest.approx(least)
    assert sign_flip_test(*far_apart(30, 30, 1000.0)) == pytest.approx(least)


def test_many_ranks_are_approximately_normal() -> None:
    first, second = far_apart(30, 25, 0.5)
    expected = stats.mannwhitneyu(first, second, method="asymptotic").pvalue
    assert rank_sum_test(first, second) == pytest.approx(expected, abs=1e-10)
    one, two = far_apart(40, 40, 0.4)
    assert signed_rank_test(one, two) == pytest.approx(stats.wilcoxon(one - two, method="asymptotic").pvalue, abs=1e-10)


def test_the_normal_approximations_continue_the_exact_tests() -> None:
    """Just beyond the limit and where decisions fall; the exact p-values are SciPy's."""
    first, second = far_apart(11, 11, 0.8)
    assert rank_sum_test(first, second) == pytest.approx(
        stats.mannwhitneyu(first, second, method="exact").pvalue, abs=0.01
    )
    one, two = far_apart(18, 18, 1.2)
    assert signed_rank_test(one, two) == pytest.approx(stats.wilcoxon(one - two, method="exact").pvalue, abs=0.01)


def test_ties_among_many_ranks_are_corrected_for() -> None:
    """SciPy's correction for ties, on scores of which many are equal but for rounding."""
    random = np.random.default_rng(5)
    tenths = random.integers(0, 6, (2, 40))
    one, two = 50.0 + tenths / 10
    nonzero = (tenths[0] - tenths[1]).astype(np.float64)
    nonzero = nonzero[nonzero != 0]
    expected = stats.wilcoxon(nonzero, method="asymptotic").pvalue
    assert signed_rank_test(one, two) == pytest.approx(expected, abs=1e-10)
