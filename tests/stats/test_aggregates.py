from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, mannwhitneyu, trim_mean

from lfobench.stats import aggregates
from lfobench.stats.aggregates import LARGEST, Values, bootstrap, strata
from lfobench.stats.intervals import Estimate, Interval

score = st.integers(-20_000, 130_000).map(lambda thousandths: thousandths / 1000)
runs = st.lists(score, min_size=1, max_size=6)
ragged = st.lists(runs, min_size=1, max_size=6)
tables = st.tuples(st.integers(1, 7), st.integers(1, 7)).flatmap(
    lambda shape: st.lists(score, min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]).map(
        lambda values: np.array(values).reshape(shape)
    )
)

Aggregate = Callable[..., Estimate]
LOCATIONS: list[Aggregate] = [aggregates.interquartile_mean, aggregates.mean, aggregates.median]
QUICK: dict[str, Any] = {"replicates": 40}


def ends(estimate: Estimate) -> tuple[float, float]:
    assert estimate.interval is not None
    return estimate.interval.low, estimate.interval.high


def normal_table(seed: int, runs: int = 5, tasks: int = 6) -> Values:
    return np.random.default_rng(seed).normal(60.0, 20.0, (runs, tasks))


@given(tables)
def test_the_interquartile_mean_is_scipys_trimmed_mean(table: Values) -> None:
    expected = trim_mean(table, 0.25, axis=None)
    assert aggregates.interquartile_mean(table, **QUICK).value == pytest.approx(expected, rel=1e-12, abs=1e-12)


def trimmed_by_copies(tasks: list[list[float]]) -> float:
    """The definition in whole numbers: every run repeated until all tasks have as many copies, a share cut off."""
    common = math.lcm(*(len(task) for task in tasks))
    total = sum(len(task) for task in tasks)
    # Every run is copied `total` times more, so that the cut ⌊N/4⌋ / N of all copies is a whole number of them.
    copies = sorted(value for task in tasks for value in task for _ in range(total * common // len(task)))
    cut = (total // 4) * len(copies) // total
    return statistics.fmean(copies[cut : len(copies) - cut])


@given(st.lists(st.lists(score, min_size=1, max_size=4), min_size=1, max_size=5))
@settings(max_examples=50)
def test_the_interquartile_mean_of_unequal_runs_trims_by_weight(tasks: list[list[float]]) -> None:
    value = aggregates.interquartile_mean(tasks, **QUICK).value
    assert value == pytest.approx(trimmed_by_copies(tasks), rel=1e-10, abs=1e-10)


@given(ragged)
def test_mean_and_median_are_what_plain_loops_say(tasks: list[list[float]]) -> None:
    means = [statistics.fmean(task) for task in tasks]
    values = [aggregate(tasks, **QUICK).value for aggregate in LOCATIONS[1:]]
    expected = [statistics.fmean(means), statistics.median(means)]
    assert values == pytest.approx(expected, rel=1e-10, abs=1e-10)


@given(st.lists(st.tuples(runs, runs), min_size=1, max_size=5))
def test_probability_of_improvement_is_the_mann_whitney_statistic(tasks: list[tuple[list[float], list[float]]]) -> None:
    first, second = zip(*tasks, strict=True)
    expected = statistics.fmean(mannwhitneyu(x, y).statistic / (len(x) * len(y)) for x, y in tasks)
    there = aggregates.probability_of_improvement(first, second, **QUICK).value
    back = aggregates.probability_of_improvement(second, first, **QUICK).value
    assert there == pytest.approx(expected, rel=1e-10, abs=1e-10)
    assert back == pytest.approx(1.0 - there, abs=1e-12)


def test_a_tie_counts_half_and_a_sure_win_one() -> None:
    assert aggregates.probability_of_improvement([[1.0, 1.0]], [[1.0, 1.0]]) == Estimate(0.5, None)
    assert aggregates.probability_of_improvement([[2.0, 3.0]], [[1.0]]) == Estimate(1.0, None)


def test_swapped_methods_have_nearly_mirrored_intervals() -> None:
    first, second = normal_table(1), normal_table(2) + 5.0
    there = ends(aggregates.probability_of_improvement(first, second))
    back = ends(aggregates.probability_of_improvement(second, first))
    assert (1.0 - back[1], 1.0 - back[0]) == pytest.approx(there, abs=0.01)


def test_methods_need_the_same_tasks() -> None:
    with pytest.raises(ValueError, match="same tasks; got 2 and 1"):
        aggregates.probability_of_improvement([[1.0], [2.0]], [[1.0]])


@given(ragged, st.lists(score, min_size=1, max_size=5))
def test_a_profile_is_the_fraction_of_runs_above(tasks: list[list[float]], thresholds: list[float]) -> None:
    profile = aggregates.performance_profile(tasks, thresholds, **QUICK)
    expected = [
        statistics.fmean(statistics.fmean(value > threshold for value in task) for task in tasks)
        for threshold in thresholds
    ]
    assert list(profile.values) == pytest.approx(expected, rel=1e-10, abs=1e-10)
    if profile.low is not None and profile.high is not None:
        assert profile.low.shape == profile.high.shape == (len(thresholds),)
        assert (
            (profile.low >= -1e-12).all() and (profile.low <= profile.high).all() and (profile.high <= 1 + 1e-12).all()
        )


def test_a_profile_falls_with_the_threshold() -> None:
    profile = aggregates.performance_profile(normal_table(0), np.linspace(-50, 200, 40), replicates=300)
    assert profile.low is not None and profile.high is not None
    for curve in (profile.values, profile.low, profile.high):
        assert (np.diff(curve) <= 1e-12).all()
        assert curve[0] == pytest.approx(1.0) and curve[-1] == 0.0


def test_the_band_of_a_profile_is_the_binomial_of_one_task() -> None:
    """Drawing n runs of which k are above gives a binomial number above."""
    values = [10.0] * 7 + [90.0] * 13
    profile = aggregates.performance_profile([values], [50.0], level=0.9)
    assert profile.low is not None and profile.high is not None
    expected = np.array([binom.ppf(0.05, 20, 0.65), binom.ppf(0.95, 20, 0.65)]) / 20
    assert [profile.low[0], profile.high[0]] == pytest.approx(expected)


def reference_interval(statistic: Callable[[list[Any]], float], tasks: list[list[float]], replicates: int) -> Interval:
    """The stratified bootstrap as a plain loop over replicates and tasks, with its own generator."""
    random = np.random.default_rng(99)
    drawn = [
        statistic([random.choice(task, size=len(task), replace=True) for task in tasks]) for _ in range(replicates)
    ]
    return Interval(*np.quantile(drawn, [0.025, 0.975]), level=0.95)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aggregate", "plain"),
    [
        (aggregates.interquartile_mean, lambda tasks: trim_mean(np.concatenate(tasks), 0.25)),
        (aggregates.mean, lambda tasks: np.mean([task.mean() for task in tasks])),
        (aggregates.median, lambda tasks: np.median([task.mean() for task in tasks])),
    ],
)
def test_intervals_agree_with_a_loop_over_replicates(aggregate: Aggregate, plain: Callable[[list[Any]], float]) -> None:
    table = np.random.default_rng(3).normal(90.0, 20.0, (5, 6))
    estimate = aggregate(table)
    expected = reference_interval(plain, [list(column) for column in table.T], 4000)
    # Both ends are quantiles of a nearly normal spread; the loop's have a standard error of about 2.7 % of its std.
    spread = (expected.high - expected.low) / 4
    assert ends(estimate) == pytest.approx((expected.low, expected.high), abs=0.2 * spread)


def test_the_interval_of_the_interquartile_mean_of_unequal_runs_agrees_with_a_loop() -> None:
    random = np.random.default_rng(4)
    tasks = [random.normal(60.0 + 5 * n, 20.0, n).tolist() for n in (2, 3, 6, 6, 4)]
    expected = reference_interval(trimmed_by_copies, tasks, 2000)
    # The loop's ends have a standard error of about 4 % of the spread here.
    spread = (expected.high - expected.low) / 4
    assert ends(aggregates.interquartile_mean(tasks)) == pytest.approx((expected.low, expected.high), abs=0.3 * spread)


def test_the_spread_of_the_mean_is_that_of_the_formula() -> None:
    """Variance of a stratified bootstrap mean: the sum over tasks of the biased variance over n, over K²."""
    tasks = [[0.0, 10.0, 20.0, 60.0], [5.0, 5.0], [70.0], [10.0, 20.0, 90.0]]
    pool = strata(tasks)
    shares = pool.values * pool.weights / pool.values.size
    drawn = bootstrap(lambda counts: shares @ counts, [pool], 40_000)
    expected = math.sqrt(sum(np.var(task) / len(task) for task in tasks)) / len(tasks)
    assert drawn.std() == pytest.approx(expected, rel=5 / math.sqrt(2 * 40_000))
    assert drawn.mean() == pytest.approx(np.mean([np.mean(task) for task in tasks]), abs=5 * expected / 200)


@pytest.mark.parametrize("aggregate", LOCATIONS)
@given(tasks=ragged, random=st.randoms(use_true_random=False))
@settings(max_examples=25)
def test_the_order_of_runs_and_tasks_does_not_matter(aggregate: Aggregate, tasks: Any, random: Any) -> None:
    shuffled = [random.sample(task, len(task)) for task in tasks]
    assert aggregate(shuffled, **QUICK) == aggregate(tasks, **QUICK)
    moved = random.sample(shuffled, len(shuffled))
    assert aggregate(moved, **QUICK).value == pytest.approx(aggregate(tasks, **QUICK).value, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("aggregate", LOCATIONS)
@given(tasks=ragged, shift=st.integers(-100, 100), scale=st.sampled_from([0.25, 3.0, 1e6]))
@settings(max_examples=25)
def test_locations_follow_unit_and_origin(aggregate: Aggregate, tasks: Any, shift: int, scale: float) -> None:
    one = aggregate(tasks, **QUICK)
    other = aggregate([[scale * (value + shift) for value in task] for task in tasks], **QUICK)
    assert other.value == pytest.approx(scale * (one.value + shift), rel=1e-9, abs=scale * 1e-9)
    assert (one.interval is None) == (other.interval is None)
    if one.interval is not None:
        expected = [scale * (end + shift) for end in ends(one)]
        assert ends(other) == pytest.approx(expected, rel=1e-9, abs=scale * 1e-9)


@pytest.mark.parametrize("aggregate", LOCATIONS)
def test_intervals_are_decided_by_the_seed_and_widen_with_the_level(aggregate: Aggregate) -> None:
    table = normal_table(4)
    assert aggregate(table, replicates=300, seed=7) == aggregate(table, replicates=300, seed=7)
    assert aggregate(table, replicates=300, seed=7) != aggregate(table, replicates=300, seed=8)
    narrow, wide = (ends(aggregate(table, level=level, replicates=300)) for level in (0.5, 0.95))
    assert wide[0] < narrow[0] < narrow[1] < wide[1]


@pytest.mark.parametrize("aggregate", LOCATIONS)
def test_one_run_per_task_has_no_interval(aggregate: Aggregate) -> None:
    assert aggregate([[50.0], [70.0]]).interval is None
    assert aggregate([[50.0], [70.0, 80.0]], **QUICK).interval is not None


def test_one_run_per_task_compares_without_an_interval() -> None:
    assert aggregates.probability_of_improvement([[3.0], [1.0]], [[2.0], [2.0]]) == Estimate(0.5, None)
    profile = aggregates.performance_profile([[3.0], [1.0]], [2.0])
    assert list(profile.values) == [0.5]
    assert profile.low is None and profile.high is None


@pytest.mark.parametrize("aggregate", LOCATIONS)
@pytest.mark.parametrize("wrong", [[], [[1.0], []], [[1.0, math.nan]]])
def test_scores_that_are_no_table_are_an_error(aggregate: Aggregate, wrong: list[list[float]]) -> None:
    with pytest.raises(ValueError, match=r"Scores"):
        aggregate(wrong)


def test_an_outlier_that_is_trimmed_costs_no_digit() -> None:
    table = np.array([[1.0, 2.0, 3.0, 1e300]]).T
    estimate = aggregates.interquartile_mean(table, level=0.5)
    assert estimate.value == 2.5


def test_the_interval_of_many_tasks_covers_better_than_that_of_one() -> None:
    """Five runs on 24 tasks: about 0.92 of intervals at 0.95 cover, against 0.84 for the mean of one task."""
    random = np.random.default_rng(11)
    rows = 400
    covered = 0
    for _ in range(rows):
        low, high = ends(aggregates.mean(random.normal(size=(5, 24)), replicates=400))
        covered += low <= 0.0 <= high
    assert covered / rows == pytest.approx(0.92, abs=4 * math.sqrt(0.92 * 0.08 / rows))


@pytest.mark.parametrize("aggregate", LOCATIONS)
def test_the_largest_scores_do_not_overflow(aggregate: Aggregate) -> None:
    for tasks in ([[LARGEST] * 5, [LARGEST] * 3], [[LARGEST, 1.0, -LARGEST], [0.5 * LARGEST] * 4]):
        found = aggregate(tasks, **QUICK)
        assert math.isfinite(found.value)
        assert found.interval is None or math.isfinite(found.interval.low + found.interval.high)
    with pytest.raises(ValueError, match="within"):
        aggregate([[1.7e308, 1.0]], **QUICK)
