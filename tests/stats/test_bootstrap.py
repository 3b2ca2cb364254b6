from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.stats.aggregates import Counts, Values, bootstrap, resample, strata

sizes = st.lists(st.integers(1, 6), min_size=1, max_size=5)
scores = st.integers(-20_000, 130_000).map(lambda thousandths: thousandths / 1000)
samples = st.lists(scores, min_size=2, max_size=8)


def all_counts(sizes: list[int], seed: int, block: int, replicates: int = 50) -> Counts:
    random = np.random.default_rng(seed)
    return np.concatenate(list(resample(np.array(sizes), replicates, random, block)), axis=1)


@given(sizes, st.integers(0, 100))
def test_every_task_is_drawn_as_often_as_it_has_runs(sizes: list[int], seed: int) -> None:
    counts = all_counts(sizes, seed, block=16)
    assert counts.shape == (sum(sizes), 50)
    assert (counts >= 0).all()
    for task in np.split(counts, np.cumsum(sizes)[:-1]):
        assert (task.sum(axis=0) == len(task)).all()


@given(sizes, st.integers(0, 100), st.integers(1, 60), st.integers(1, 60))
def test_draws_do_not_depend_on_the_size_of_the_blocks(sizes: list[int], seed: int, one: int, other: int) -> None:
    np.testing.assert_array_equal(all_counts(sizes, seed, one), all_counts(sizes, seed, other))


def test_more_replicates_extend_fewer() -> None:
    few, many = (all_counts([3, 4], 0, 7, replicates) for replicates in (20, 50))
    np.testing.assert_array_equal(few, many[:, :20])


def test_runs_are_drawn_with_equal_chances_and_independently() -> None:
    """Multinomial moments: mean 1, variance 1 - 1/n, covariance -1/n within a task and 0 between tasks."""
    sizes = [3, 3, 5]
    replicates = 20_000
    counts = all_counts(sizes, 1, 500, replicates)
    expected = np.zeros((11, 11))
    for start, n in zip([0, 3, 6], sizes, strict=True):
        expected[start : start + n, start : start + n] = np.eye(n) - 1 / n
    # The product of two counts has a variance below 3: five standard errors.
    tolerance = 5 * math.sqrt(3 / replicates)
    np.testing.assert_allclose(counts.mean(axis=1), 1.0, atol=tolerance)
    np.testing.assert_allclose(np.cov(counts), expected, atol=tolerance)


@given(st.lists(samples, min_size=1, max_size=4), st.integers(1, 5000), st.integers(1, 5000))
@settings(max_examples=30)
def test_replicates_do_not_depend_on_the_draws_held_at_once(tasks: list[list[float]], one: int, other: int) -> None:
    methods = [strata(tasks), strata(tasks)]

    def statistic(first: Counts, second: Counts) -> Values:
        return methods[0].values @ first - methods[1].values @ second

    first, second = (bootstrap(statistic, methods, 60, seed=3, draws_at_once=held) for held in (one, other))
    np.testing.assert_allclose(first, second, rtol=1e-12, atol=1e-9)


def test_methods_are_drawn_from_independent_streams() -> None:
    methods = [strata([[1.0, 2.0, 3.0, 4.0]])] * 2
    drawn = bootstrap(lambda *counts: np.stack([methods[0].values @ one for one in counts], axis=1), methods, 5000)
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 5 / math.sqrt(5000)


def test_weights_let_tasks_count_equally() -> None:
    weights = strata([[1.0], [1.0, 2.0], [1.0, 2.0, 3.0]]).weights
    np.testing.assert_allclose(weights, [2.0, 1.0, 1.0, 2 / 3, 2 / 3, 2 / 3], rtol=1e-14)


@given(st.integers(1, 9), st.integers(1, 30))
def test_equal_runs_weigh_exactly_one(runs: int, tasks: int) -> None:
    assert (strata(np.zeros((runs, tasks))).weights == 1.0).all()


def test_an_array_holds_runs_by_tasks() -> None:
    table = np.arange(6.0).reshape(3, 2)
    from_array, from_tasks = strata(table), strata([[0.0, 2.0, 4.0], [1.0, 3.0, 5.0]])
    np.testing.assert_array_equal(from_array.values, from_tasks.values)
    np.testing.assert_array_equal(from_array.sizes, [3, 3])


@pytest.mark.parametrize(
    "wrong", [[], [[]], [[1.0], []], [[1.0, math.nan]], [[math.inf]], np.zeros(3), np.zeros((0, 2)), np.zeros((2, 0))]
)
def test_scores_that_are_no_table_are_an_error(wrong: list[list[float]]) -> None:
    with pytest.raises(ValueError, match=r"[Ss]cores"):
        strata(wrong)


def test_a_bootstrap_needs_a_replicate() -> None:
    with pytest.raises(ValueError, match="at least one replicate"):
        bootstrap(lambda counts: counts, [strata([[1.0, 2.0]])], 0, 0)


def test_the_seed_decides_the_draws() -> None:
    method = strata([[1.0, 2.5, 3.1, 7.7, 9.2], [4.0, 5.0]])
    one, same, other = (bootstrap(lambda counts: method.values @ counts, [method], 500, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert abs(np.corrcoef(one, other)[0, 1]) < 5 / math.sqrt(500)
