from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import ttest_ind

from lfobench.stats.comparison import welch_test
from lfobench.stats.summary import Summary, summarize

# Scores on a grid of 0.001: no property is lost to cancellation in differences of nearly equal numbers.
scores = st.integers(min_value=-20_000, max_value=130_000).map(lambda thousandths: thousandths / 1000)
samples = st.lists(scores, min_size=2, max_size=10)
varied = samples.filter(lambda values: len(set(values)) > 1)


def welch_test_of_samples(first: Sequence[float], second: Sequence[float]) -> float | None:
    return welch_test(summarize(first), summarize(second))


@given(varied, varied)
def test_agrees_with_scipy_on_samples(first: list[float], second: list[float]) -> None:
    expected = ttest_ind(first, second, equal_var=False).pvalue
    assert welch_test_of_samples(first, second) == pytest.approx(expected, rel=1e-6, abs=1e-12)


@given(samples, samples)
def test_is_symmetric(first: list[float], second: list[float]) -> None:
    assert welch_test_of_samples(first, second) == pytest.approx(welch_test_of_samples(second, first), rel=1e-9)


@given(varied, varied, st.integers(-100, 100), st.sampled_from([1e-6, 0.5, 3.0, 1e6]))
def test_does_not_depend_on_unit_and_origin(first: list[float], second: list[float], shift: int, scale: float) -> None:
    p = welch_test_of_samples(first, second)
    moved = [[scale * (value + shift) for value in values] for values in (first, second)]
    assert welch_test_of_samples(*moved) == pytest.approx(p, rel=1e-5, abs=1e-9)


@given(samples, samples)
def test_is_a_probability(first: list[float], second: list[float]) -> None:
    p = welch_test_of_samples(first, second)
    assert p is not None
    assert 0.0 <= p <= 1.0


@given(samples)
def test_equal_samples_are_not_told_apart(values: list[float]) -> None:
    assert welch_test_of_samples(values, values) == pytest.approx(1.0)


@given(varied, st.floats(min_value=1.0, max_value=50.0))
def test_a_larger_difference_is_more_significant(values: list[float], shift: float) -> None:
    near = welch_test_of_samples(values, [value + shift for value in values])
    far = welch_test_of_samples(values, [value + 2 * shift for value in values])
    assume(near is not None and near > 1e-12)
    assert far is not None and near is not None
    assert far < near


def test_a_single_sample_cannot_be_tested() -> None:
    assert welch_test_of_samples([100.0], [1.0, 2.0, 3.0]) is None
    assert welch_test(Summary(5, 1.0, 0.5), Summary(1, 100.0, None)) is None


def test_without_any_spread_the_means_decide() -> None:
    assert welch_test(Summary(5, 0.0, 0.0), Summary(5, 50.0, 0.0)) == 0.0
    assert welch_test(Summary(5, 50.0, 0.0), Summary(3, 50.0, 0.0)) == 1.0


def test_zero_spread_on_one_side_is_a_one_sample_test() -> None:
    from scipy.stats import ttest_1samp

    values = [3.0, 4.5, 5.0, 4.0]
    expected = ttest_1samp(values, 2.0).pvalue
    assert welch_test_of_samples(values, [2.0, 2.0, 2.0]) == pytest.approx(expected)


def test_a_tiny_spread_does_not_underflow() -> None:
    p = welch_test(Summary(5, 1.0, 1e-170), Summary(5, 1.0, 3e-170))
    assert p == pytest.approx(1.0)


def test_a_published_pair() -> None:
    """Table 1 of arXiv:2406.08805v2, random+expert halfcheetah: DILO against SMODICE at n = 5."""
    p = welch_test(Summary(5, 91.18, 0.24), Summary(5, 85.16, 3.62))
    assert p == pytest.approx(0.0205, abs=5e-4)


def test_scipy_is_not_imported_before_a_test_is_made() -> None:
    code = "import sys, lfobench.render.formats, lfobench.render.building; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
