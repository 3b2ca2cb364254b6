from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest, fisher_exact

from lfobench.stats.successes import boschloo_test, fisher_test, wilson_interval

counts = st.integers(1, 60).flatmap(lambda trials: st.tuples(st.integers(0, trials), st.just(trials)))
few = st.integers(1, 8).flatmap(lambda trials: st.tuples(st.integers(0, trials), st.just(trials)))


def test_known_values() -> None:
    interval = wilson_interval(8, 10)
    assert (interval.low, interval.high) == pytest.approx((0.49, 0.943), abs=5e-4)
    assert fisher_test(9, 10, 4, 10) == pytest.approx(0.057, abs=5e-4)


@given(counts, st.sampled_from([0.5, 0.9, 0.95, 0.99]))
def test_the_wilson_interval_agrees_with_scipy(count: tuple[int, int], level: float) -> None:
    interval = wilson_interval(*count, level)
    expected = binomtest(*count).proportion_ci(level, method="wilson")
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high), rel=1e-10, abs=1e-12)


@pytest.mark.slow
@given(counts)
def test_the_wilson_interval_contains_the_rate_and_mirrors(count: tuple[int, int]) -> None:
    successes, trials = count
    interval, mirrored = wilson_interval(successes, trials), wilson_interval(trials - successes, trials)
    assert 0.0 <= interval.low <= successes / trials <= interval.high <= 1.0
    assert (1.0 - mirrored.high, 1.0 - mirrored.low) == pytest.approx((interval.low, interval.high), abs=1e-12)


@pytest.mark.parametrize("trials", [1, 3, 7, 1000])
def test_the_ends_are_exact_for_all_and_for_none(trials: int) -> None:
    assert wilson_interval(0, trials).low == 0.0
    assert wilson_interval(trials, trials).high == 1.0


def hypergeometric_p(a: int, n: int, b: int, m: int) -> float:
    """Fisher's two-sided p from its definition: all tables with the same margins that are no likelier."""
    chances = [math.comb(n, k) * math.comb(m, a + b - k) for k in range(max(0, a + b - m), min(n, a + b) + 1)]
    observed = math.comb(n, a) * math.comb(m, b)
    return sum(chance for chance in chances if chance <= observed) / math.comb(n + m, a + b)


@given(counts, counts)
def test_fishers_test_is_its_definition(first: tuple[int, int], second: tuple[int, int]) -> None:
    assert fisher_test(*first, *second) == pytest.approx(hypergeometric_p(*first, *second), rel=1e-10)


def one_sided_boschloo(first: tuple[int, int], second: tuple[int, int]) -> float:
    """From its definition: the chance of a one-sided Fisher p no larger, at the worst common rate on a fine grid."""
    (a, n), (b, m) = first, second
    p_values = np.array(
        [
            [fisher_exact([[x, y], [n - x, m - y]], alternative="less").pvalue for y in range(m + 1)]
            for x in range(n + 1)
        ]
    )
    as_extreme = p_values <= p_values[a, b] * (1 + 1e-9)
    rates = np.linspace(0, 1, 2001)[:, None]
    chances = [
        np.array([math.comb(size, k) for k in range(size + 1)])
        * rates ** np.arange(size + 1)
        * (1 - rates) ** np.arange(size, -1, -1)
        for size in (n, m)
    ]
    return float(np.einsum("rx,xy,ry->r", chances[0], as_extreme, chances[1]).max())


@pytest.mark.parametrize(
    ("first", "second"), [((9, 10), (4, 10)), ((1, 5), (4, 5)), ((2, 7), (3, 4)), ((5, 5), (0, 3))]
)
def test_boschloos_test_is_its_definition(first: tuple[int, int], second: tuple[int, int]) -> None:
    expected = min(1.0, 2 * min(one_sided_boschloo(first, second), one_sided_boschloo(second, first)))
    assert boschloo_test(*first, *second) == pytest.approx(expected, rel=1e-4)


@given(few, few)
@settings(max_examples=15)
def test_tests_are_symmetric_probabilities(first: tuple[int, int], second: tuple[int, int]) -> None:
    for test in (fisher_test, boschloo_test):
        p = test(*first, *second)
        assert 0.0 <= p <= 1.0 + 1e-12
        assert test(*second, *first) == pytest.approx(p, rel=1e-6)


@pytest.mark.parametrize("test", [fisher_test, boschloo_test])
@pytest.mark.parametrize("rate", [0, 1])
def test_all_or_nothing_on_both_sides_is_no_difference(test: object, rate: int) -> None:
    assert callable(test)
    assert test(5 * rate, 5, 7 * rate, 7) == 1.0


@pytest.mark.parametrize(("successes", "trials"), [(1, 0), (0, 0), (-1, 5), (6, 5), (2.5, 5)])
def test_counts_that_are_none_are_an_error(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match="whole counts"):
        wilson_interval(successes, trials)
    for test in (fisher_test, boschloo_test):
        with pytest.raises(ValueError, match="whole counts"):
            test(successes, trials, 1, 2)
        with pytest.raises(ValueError, match="whole counts"):
            test(1, 2, successes, trials)
