from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import chi2, norm, t, ttest_ind

from lfobench.stats.power import detectable_effect, power, power_for, seeds_needed, seeds_needed_for

effects = st.integers(0, 60).map(lambda tenths: tenths / 10)
spreads = st.integers(1, 300).map(lambda tenths: tenths / 10)
alphas = st.sampled_from([0.01, 0.05, 0.2])


@pytest.mark.parametrize(("n", "effect"), [(3, 3.07), (5, 2.02), (7, 1.63), (10, 1.32), (20, 0.91)])
def test_known_detectable_effects(n: int, effect: float) -> None:
    assert detectable_effect(n) == pytest.approx(effect, abs=0.005)


@pytest.mark.parametrize(
    ("effect", "n", "alpha"), [(0.0, 5, 0.05), (0.5, 2, 0.05), (1.0, 3, 0.01), (2.02, 5, 0.05), (0.8, 26, 0.05)]
)
def test_power_is_the_normal_chance_averaged_over_the_spread(effect: float, n: int, alpha: float) -> None:
    """The definition: given the pooled variance, the difference of means is normal."""
    degrees = 2 * n - 2
    critical, shift = t.isf(alpha / 2, degrees), effect * math.sqrt(n / 2)

    def rejected(variance: float) -> float:
        bound = critical * math.sqrt(variance / degrees)
        return float(chi2.pdf(variance, degrees) * (norm.sf(bound - shift) + norm.cdf(-bound - shift)))

    expected = quad(rejected, 0, math.inf, epsabs=1e-12, epsrel=1e-12, limit=400)[0]
    assert power(effect, n, alpha) == pytest.approx(expected, abs=1e-9)


@given(st.integers(2, 50), alphas)
def test_without_an_effect_power_is_alpha(n: int, alpha: float) -> None:
    assert power(0.0, n, alpha) == pytest.approx(alpha, rel=1e-10)


@given(effects, st.integers(2, 40), alphas)
def test_power_grows_with_effect_seeds_and_alpha(effect: float, n: int, alpha: float) -> None:
    base = power(effect, n, alpha)
    assert 0.0 <= base <= 1.0 + 1e-12
    assert power(-effect, n, alpha) == base
    assert power(effect + 0.3, n, alpha) >= base - 1e-12
    assert power(effect, n + 1, alpha) >= base - 1e-12
    assert power(effect, n, alpha * 1.5) >= base - 1e-12


@pytest.mark.parametrize("effect", [30.0, 1e3, 1e6])
@pytest.mark.parametrize("n", [3, 20, 1000])
def test_a_huge_effect_is_always_seen(effect: float, n: int) -> None:
    assert power(effect, n) == pytest.approx(1.0)


def test_one_seed_shows_nothing() -> None:
    assert power(100.0, 1) == 0.0
    assert detectable_effect(1) is None


@given(st.integers(2, 60), st.sampled_from([0.5, 0.8, 0.95]), alphas)
@settings(max_examples=30)
def test_the_detectable_effect_has_the_power_asked_for(n: int, target: float, alpha: float) -> None:
    effect = detectable_effect(n, target, alpha)
    assert effect is not None
    assert power(effect, n, alpha) == pytest.approx(target, abs=1e-9)


def test_a_power_below_alpha_needs_no_effect() -> None:
    assert detectable_effect(5, power=0.04, alpha=0.05) == 0.0


@given(st.integers(4, 40).map(lambda tenths: tenths / 10), st.sampled_from([0.5, 0.8, 0.95]))
@settings(max_examples=30)
def test_the_seeds_needed_are_enough_and_no_more(effect: float, target: float) -> None:
    n = seeds_needed(effect, target)
    assert n is not None
    assert power(effect, n) >= target
    assert n == 2 or power(effect, n - 1) < target


def test_cohens_table_of_sample_sizes() -> None:
    """Cohen 1988, table 2.4.1: two-sided α 0.05 and power 0.80 for small, medium and large effects."""
    assert [seeds_needed(effect) for effect in (0.2, 0.5, 0.8)] == [394, 64, 26]


def test_seeds_that_are_too_many_are_none() -> None:
    assert seeds_needed(0.0) is None
    assert seeds_needed(0.8, most=26) == 26
    assert seeds_needed(0.8, most=25) is None
    assert seeds_needed(5.0, most=1) is None


@given(effects.filter(bool), spreads, st.integers(2, 30))
def test_equal_spreads_are_the_exact_power_in_any_unit(effect: float, std: float, n: int) -> None:
    assert power_for(effect * std, std, std, n) == pytest.approx(power(effect, n), rel=1e-9)


@given(effects, spreads, spreads, st.integers(2, 30))
def test_the_sides_of_a_difference_can_be_swapped(difference: float, one: float, other: float, n: int) -> None:
    assert power_for(-difference, other, one, n) == pytest.approx(power_for(difference, one, other, n), rel=1e-10)


def test_unequal_spreads_agree_with_simulation() -> None:
    random = np.random.default_rng(0)
    rows = 20_000
    for n, ratio in [(5, 3.0), (10, 10.0)]:
        p = ttest_ind(
            random.normal(2.0 * ratio, 1.0, (rows, n)), random.normal(0.0, ratio, (rows, n)), axis=1, equal_var=False
        ).pvalue
        # Satterthwaite's approximation is good to a percent here; four standard errors of the simulation beside it.
        assert power_for(2.0 * ratio, 1.0, ratio, n) == pytest.approx(np.mean(p < 0.05), abs=0.01 + 2 / math.sqrt(rows))


@given(spreads, spreads, st.sampled_from([5.0, 10.0, 40.0]))
@settings(max_examples=30)
def test_seeds_for_a_difference_are_enough_and_no_more(one: float, other: float, difference: float) -> None:
    n = seeds_needed_for(difference, one, other, most=10_000)
    assert n is not None
    assert power_for(difference, one, other, n) >= 0.8
    assert n == 2 or power_for(difference, one, other, n - 1) < 0.8


def test_without_spread_two_seeds_see_any_difference() -> None:
    assert seeds_needed_for(0.1, 0.0, 0.0) == 2
    assert seeds_needed_for(0.0, 0.0, 0.0) is None


def test_numbers_that_mean_nothing_are_errors() -> None:
    with pytest.raises(ValueError, match="power"):
        seeds_needed(1.0, power=1.0)
    with pytest.raises(ValueError, match="alpha"):
        power(1.0, 5, alpha=0.0)
    with pytest.raises(ValueError, match="at least one sample"):
        power(1.0, 0)
    with pytest.raises(ValueError, match="effect"):
        power(math.nan, 5)
    with pytest.raises(ValueError, match="effect"):
        power_for(1.0, -1.0, 1.0, 5)
