from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from lfobench.stats.intervals import Interval, Summary, satterthwaite, summarize, t_interval, welch_interval
from lfobench.stats.tests import welch_test

means = st.integers(-20_000, 130_000).map(lambda thousandths: thousandths / 1000)
spreads = st.integers(1, 40_000).map(lambda thousandths: thousandths / 1000)
summaries = st.builds(Summary, st.integers(2, 30), means, spreads)
levels = st.sampled_from([0.5, 0.8, 0.9, 0.95, 0.99])


@given(summaries, levels)
def test_the_t_interval_agrees_with_scipy(summary: Summary, level: float) -> None:
    assert summary.std is not None
    interval = t_interval(summary, level)
    assert interval is not None
    expected = stats.t.interval(level, summary.n - 1, loc=summary.mean, scale=summary.std / math.sqrt(summary.n))
    assert (interval.low, interval.high) == pytest.approx(expected, rel=1e-10, abs=1e-10)


def test_the_welch_interval_agrees_with_scipy() -> None:
    random = np.random.default_rng(0)
    for n, m in [(2, 2), (3, 7), (5, 5), (10, 4)]:
        first, second = random.normal(60, 3, n), random.normal(50, 20, m)
        interval = welch_interval(summarize(first.tolist()), summarize(second.tolist()), 0.9)
        expected = stats.ttest_ind(first, second, equal_var=False).confidence_interval(0.9)
        assert interval is not None
        assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high), rel=1e-10)


@given(summaries, summaries, st.sampled_from([0.01, 0.05, 0.1, 0.3]))
def test_the_welch_interval_excludes_zero_exactly_when_the_test_rejects(
    first: Summary, second: Summary, alpha: float
) -> None:
    p = welch_test(first, second)
    interval = welch_interval(first, second, 1 - alpha)
    assert p is not None and interval is not None
    assume(abs(p - alpha) > 1e-9)
    assert (not interval.low <= 0 <= interval.high) == (p < alpha)


@given(summaries, summaries, levels)
def test_swapping_the_sides_mirrors_the_welch_interval(first: Summary, second: Summary, level: float) -> None:
    one, other = welch_interval(first, second, level), welch_interval(second, first, level)
    assert one is not None and other is not None
    assert (one.low, one.high) == pytest.approx((-other.high, -other.low), rel=1e-12, abs=1e-12)


@given(summaries, st.integers(-100, 100), st.sampled_from([0.25, 3.0, 1e6]), levels)
def test_the_t_interval_follows_unit_and_origin(summary: Summary, shift: int, scale: float, level: float) -> None:
    assert summary.std is not None
    moved = Summary(summary.n, scale * (summary.mean + shift), scale * summary.std)
    one, other = t_interval(summary, level), t_interval(moved, level)
    assert one is not None and other is not None
    assert (other.low, other.high) == pytest.approx(
        (scale * (one.low + shift), scale * (one.high + shift)), rel=1e-9, abs=scale * 1e-9
    )


@given(summaries, summaries)
def test_intervals_contain_their_estimate_and_grow_with_the_level(first: Summary, second: Summary) -> None:
    for at in (lambda level: t_interval(first, level), lambda level: welch_interval(first, second, level)):
        narrow, wide = at(0.5), at(0.95)
        assert narrow is not None and wide is not None
        assert wide.low < narrow.low < narrow.high < wide.high
    interval = t_interval(first)
    assert interval is not None and interval.low <= first.mean <= interval.high


@given(st.integers(2, 30), st.integers(2, 30), spreads, spreads)
def test_degrees_of_freedom_lie_between_the_smaller_side_and_both(
    n: int, m: int, std_first: float, std_second: float
) -> None:
    _, degrees = satterthwaite(std_first, n, std_second, m)
    assert min(n, m) - 1 - 1e-9 <= degrees <= n + m - 2 + 1e-9


def test_equal_sides_have_the_degrees_of_freedom_of_students_test() -> None:
    error, degrees = satterthwaite(3.0, 5, 3.0, 5)
    assert (error, degrees) == pytest.approx((3.0 * math.sqrt(2 / 5), 8.0), rel=1e-14)


def test_one_sample_has_no_interval() -> None:
    assert t_interval(Summary(1, 50.0, None)) is None
    assert welch_interval(Summary(1, 50.0, None), Summary(5, 50.0, 1.0)) is None
    assert welch_interval(Summary(5, 50.0, 1.0), Summary(1, 50.0, None)) is None


def test_without_spread_the_interval_is_a_point() -> None:
    assert t_interval(Summary(5, 50.0, 0.0), 0.9) == Interval(50.0, 50.0, 0.9)
    assert welch_interval(Summary(5, 50.0, 0.0), Summary(3, 20.0, 0.0)) == Interval(30.0, 30.0, 0.95)


def test_a_tiny_spread_does_not_underflow() -> None:
    interval = welch_interval(Summary(5, 0.0, 1e-170), Summary(5, 0.0, 3e-170))
    assert interval is not None
    assert interval.high == pytest.approx(1e-170 * math.sqrt(2.0) * stats.t.isf(0.025, 4.878048780487805), rel=1e-9)


@pytest.mark.parametrize("level", [0.0, 1.0, 95.0, -0.5, math.nan])
def test_a_level_is_a_probability(level: float) -> None:
    with pytest.raises(ValueError, match="level must lie strictly between 0 and 1"):
        t_interval(Summary(5, 1.0, 1.0), level)
    with pytest.raises(ValueError, match="level"):
        welch_interval(Summary(5, 1.0, 1.0), Summary(5, 1.0, 1.0), level)


@pytest.mark.parametrize("n", [3, 5])
def test_the_t_interval_covers_the_mean_as_often_as_it_says(n: int) -> None:
    rows = np.random.default_rng(n).normal(60.0, 20.0, (4000, n))
    intervals = [t_interval(summarize(row.tolist())) for row in rows]
    covered = [interval is not None and interval.low <= 60.0 <= interval.high for interval in intervals]
    assert np.mean(covered) == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / len(rows)))
