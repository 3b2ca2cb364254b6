from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import chi2, nct, norm, t, ttest_ind

from lfobench.stats.highlight import adjusted
from lfobench.stats.power import detectable_effect, power, power_for, seeds_needed, seeds_needed_for

effects = st.integers(0, 60).map(lambda tenths: tenths / 10)
spreads = st.integers(1, 300).map(lambda tenths: tenths / 10)
alphas = st.sampled_from([0.01, 0.05, 0.2])


def simulated(difference: float, one: float, other: float, n: int, rows: int = 40_000) -> np.ndarray:
    """p-values of SciPy's Welch test of normal samples with these spreads, ``[rows]``."""
    random = np.random.default_rng([n, round(1000 * one), round(1000 * other)])
    first, second = random.normal(difference, one, (rows, n)), random.normal(0.0, other, (rows, n))
    return np.asarray(ttest_ind(first, second, axis=1, equal_var=False).pvalue)


def standard_error(rate: float, rows: int = 40_000) -> float:
    return math.sqrt(max(rate * (1.0 - rate), 1.0 / rows) / rows)


@pytest.mark.parametrize(("one", "other"), [(1.0, 1.0), (1.0, 0.3), (2.0, 0.1)])
@pytest.mark.parametrize("n", range(2, 11))
def test_power_is_that_of_simulated_tests_with_and_without_holm(n: int, one: float, other: float) -> None:
    """At α and at the first step of Holm over 24 rows; four standard errors of 40,000 simulated tests."""
    for times in (1.5, 3.0, 5.0):
        difference = times * math.hypot(one, other) / math.sqrt(n)
        p = simulated(difference, one, other, n)
        for alpha in (0.05, 0.05 / 24):
            expected = power_for(difference, one, other, n, alpha)
            assert np.mean(p < alpha) == pytest.approx(expected, abs=4.0 * standard_error(expected))


def test_holm_sees_a_lone_effect_as_often_as_its_first_step_and_no_less() -> None:
    """One real difference among five rows: the smallest p is held against α / 5."""
    rows, n, effect = 20_000, 5, 2.8
    random = np.random.default_rng(3)
    real = simulated(effect, 1.0, 1.0, n, rows)
    null = ttest_ind(
        random.standard_normal((rows, 4, n)), random.standard_normal((rows, 4, n)), axis=2, equal_var=False
    ).pvalue
    holm = np.array([adjusted([float(p), *others], "holm")[0] for p, others in zip(real, null.tolist(), strict=True)])
    seen, first_step = float(np.mean(holm < 0.05)), power(effect, n, 0.05 / 5)
    error = standard_error(first_step, rows)
    assert first_step - 4.0 * error <= seen <= power(effect, n, 0.05)
    assert seen == pytest.approx(first_step, abs=0.01 + 4.0 * error), "further steps are seldom reached"


@pytest.mark.parametrize(("n", "welch"), [(2, 0.475), (3, 0.70), (4, 0.757), (5, 0.777), (7, 0.79)])
def test_students_formula_promised_too_much(n: int, welch: float) -> None:
    """Effects that Student's test of equal variances shows with power 0.8, by its own noncentral t distribution."""
    degrees = 2 * n - 2
    critical = t.isf(0.025, degrees)
    effect = brentq(
        lambda each: nct.sf(critical, degrees, each) + nct.sf(critical, degrees, -each) - 0.8, 0.0, 100.0
    ) * math.sqrt(2.0 / n)
    assert power(effect, n) == pytest.approx(welch, abs=0.005)
    assert power(effect, n) == pytest.approx(np.mean(simulated(effect, 1.0, 1.0, n) < 0.05), abs=0.01)


@pytest.mark.parametrize(("n", "effect"), [(3, 3.51), (5, 2.08), (7, 1.65), (10, 1.33), (20, 0.91)])
def test_known_detectable_effects(n: int, effect: float) -> None:
    """Simulated tests see them in 80 of 100."""
    assert detectable_effect(n) == pytest.approx(effect, abs=0.005)
    assert np.mean(simulated(detectable_effect(n) or 0.0, 1.0, 1.0, n) < 0.05) == pytest.approx(0.8, abs=0.008)


@pytest.mark.parametrize(
    ("difference", "one", "other", "n", "alpha"),
    [(0.0, 1.0, 1.0, 5, 0.05), (2.5, 1.0, 0.4, 3, 0.01), (2.02, 1.0, 1.0, 5, 0.05), (9.0, 4.0, 7.0, 12, 0.002)],
)
def test_power_is_the_normal_chance_averaged_over_both_spreads(
    difference: float, one: float, other: float, n: int, alpha: float
) -> None:
    """The definition: given both sample variances, the difference of means is normal and the bound is Welch's."""
    roots, weights = np.polynomial.legendre.leggauss(400)
    far = math.sqrt(float(chi2.isf(1e-12, n - 1)))
    # In the roots of the variances, whose density has no pole.
    points, weights = (roots + 1.0) * far / 2.0, weights * far / 2.0
    density = weights * 2.0 * points * chi2.pdf(points**2, n - 1)
    first, second = (points[:, None] * one) ** 2 / (n - 1) / n, (points * other) ** 2 / (n - 1) / n
    degrees = (first + second) ** 2 * (n - 1) / (first**2 + second**2)
    error = math.hypot(one, other) / math.sqrt(n)
    bound, shift = t.isf(alpha / 2, degrees) * np.sqrt(first + second) / error, difference / error
    expected = density @ (norm.sf(bound - shift) + norm.cdf(-bound - shift)) @ density
    assert power_for(difference, one, other, n, alpha) == pytest.approx(expected, abs=1e-7)


def test_without_an_effect_power_is_the_level_that_welch_keeps() -> None:
    """Below α for few samples of equal spread, and α for many."""
    for n, alpha in ((2, 0.05), (3, 0.01), (6, 0.05)):
        assert power(0.0, n, alpha) < alpha
        assert np.mean(simulated(0.0, 1.0, 1.0, n) < alpha) == pytest.approx(power(0.0, n, alpha), abs=0.004)
    assert power(0.0, 500, 0.05) == pytest.approx(0.05, abs=1e-4)


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
    """Cohen 1988, table 2.4.1: two-sided α 0.05 and power 0.80 for small, medium and large effects.

    His test is Student's, from which Welch's no longer differs with so many samples.
    """
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
