"""What a test can show at best, against p-values of the most extreme outcomes."""

from __future__ import annotations

from math import comb
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.stats.highlight import adjusted
from lfobench.stats.options import Correction, Test
from lfobench.stats.power import can_reach, smallest_p
from lfobench.stats.successes import fisher_test
from lfobench.stats.tests import EXACT_RELABELLINGS, PAIRED, p_value, sample_of

EVERY_TEST: tuple[Test, ...] = get_args(Test)
BY_RELABELLING: tuple[Test, ...] = ("mann-whitney", "permutation", "wilcoxon", "paired-permutation")


def p_of(test: Test, first: list[float], second: list[float]) -> float | None:
    if test in PAIRED:
        return p_value(test, sample_of([0.0], first), sample_of([0.0], second))
    return p_value(test, sample_of(first), sample_of(second))


@pytest.mark.parametrize("test", BY_RELABELLING)
@pytest.mark.parametrize(("n", "m"), [(2, 2), (3, 3), (5, 5), (7, 7), (2, 5), (5, 3), (8, 2)])
def test_the_most_extreme_outcome_reaches_it(test: Test, n: int, m: int) -> None:
    """One side all high, the other all low: what no relabelling but its mirror image equals."""
    m = n if test in PAIRED else m
    assert p_of(test, [1.0] * n, [0.0] * m) == pytest.approx(smallest_p(test, n, m), abs=1e-15)


@pytest.mark.parametrize("test", EVERY_TEST)
@settings(max_examples=30)
@given(data=st.data())
def test_no_outcome_goes_below_it(test: Test, data: st.DataObject) -> None:
    scores = st.integers(0, 6).map(float)
    first = data.draw(st.lists(scores, min_size=2, max_size=6))
    size = len(first) if test in PAIRED else data.draw(st.integers(2, 6))
    second = data.draw(st.lists(scores, min_size=size, max_size=size))
    p, smallest = p_of(test, first, second), smallest_p(test, len(first), len(second))
    assert p is not None and smallest is not None
    assert p >= smallest * (1 - 1e-12)


@pytest.mark.parametrize("test", ["permutation", "paired-permutation"])
def test_beyond_the_limit_it_is_one_random_relabelling(test: Test) -> None:
    n = 20
    assert comb(2 * n, n) > EXACT_RELABELLINGS < 2**n
    random = np.random.default_rng(0)
    apart = [(100.0 + random.normal(size=n)).tolist(), random.normal(size=n).tolist()]
    assert p_of(test, *apart) == pytest.approx(smallest_p(test, n, n))


@pytest.mark.parametrize("test", EVERY_TEST)
def test_one_score_tests_nothing(test: Test) -> None:
    for n, m in ((1, 1), (1, 5), (5, 1), (0, 3)):
        assert smallest_p(test, n, m) is None
        for correction in get_args(Correction):
            assert not can_reach(test, n, m, 0.05, 1, correction)


@pytest.mark.parametrize("test", ["welch", "student", "paired-t"])
def test_a_t_test_can_always_reach(test: Test) -> None:
    assert smallest_p(test, 2, 2) == 0.0
    assert can_reach(test, 2, 2, 0.05, 24, "holm")


@pytest.mark.parametrize(
    ("test", "n", "rows", "correction", "reachable"),
    [
        ("mann-whitney", 3, 1, "none", False),  # 2 / 20
        ("mann-whitney", 4, 1, "none", True),  # 2 / 70 = 0.029
        ("mann-whitney", 5, 6, "holm", True),  # 6 · 2 / 252 = 0.048
        ("mann-whitney", 5, 7, "holm", False),  # 7 · 2 / 252 = 0.056
        ("permutation", 5, 24, "holm", False),  # 24 · 2 / 252 = 0.19
        ("permutation", 7, 24, "holm", True),  # 24 · 2 / 3432 = 0.014
        ("mann-whitney", 5, 24, "bh", True),  # where all rows are as extreme
        ("wilcoxon", 5, 1, "none", False),  # 2 / 32 = 0.063
        ("wilcoxon", 6, 1, "none", True),  # 2 / 64 = 0.031
        ("paired-permutation", 10, 24, "holm", True),  # 24 · 2 / 1024 = 0.047
        ("paired-permutation", 10, 26, "holm", False),  # 26 · 2 / 1024 = 0.051
    ],
)
def test_designs(test: Test, n: int, rows: int, correction: Correction, reachable: bool) -> None:
    assert can_reach(test, n, n, 0.05, rows, correction) is reachable


@settings(max_examples=60)
@given(
    st.sampled_from(EVERY_TEST),
    st.integers(2, 8),
    st.sampled_from([0.01, 0.05, 0.2]),
    st.integers(1, 30),
    st.sampled_from(get_args(Correction)),
)
def test_reaching_is_what_the_correction_says_of_the_best_case(
    test: Test, n: int, alpha: float, rows: int, correction: Correction
) -> None:
    """One row at its smallest and the others certain for Holm; all rows at their smallest for the others."""
    smallest = smallest_p(test, n, n)
    assert smallest is not None
    best_case = [smallest] + [1.0 if correction == "holm" else smallest] * (rows - 1)
    assert can_reach(test, n, n, alpha, rows, correction) == (min(adjusted(best_case, correction)) < alpha)


# --- success counts --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 6), (4, 4), (2, 9), (10, 10), (10, 11)])
def test_fishers_test_gives_nothing_smaller(n: int, m: int) -> None:
    every = [fisher_test(a, n, b, m) for a in range(n + 1) for b in range(m + 1)]
    assert smallest_p("fisher", n, m) == pytest.approx(min(every), rel=1e-9)


def test_fishers_test_of_many_episodes_or_of_none() -> None:
    assert smallest_p("fisher", 770, 770) == 0.0, "smaller than any float"
    assert smallest_p("fisher", 0, 5) is None
    assert can_reach("fisher", 4, 4, 0.05, 1, "holm")
    assert not can_reach("fisher", 4, 4, 0.05, 2, "holm")
