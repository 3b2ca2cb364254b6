from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, friedmanchisquare

from lfobench.stats.ranking import average_ranks, critical_difference, friedman_test, groups

tables = st.tuples(st.integers(1, 6), st.integers(1, 6)).flatmap(
    lambda shape: st.lists(
        st.integers(0, 9).map(float), min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]
    ).map(lambda values: np.array(values).reshape(shape))
)
ranks = st.lists(st.integers(10, 80).map(lambda tenths: tenths / 10), min_size=1, max_size=7)


@given(tables)
def test_a_rank_counts_the_better_and_half_of_the_equal(scores: np.ndarray) -> None:
    expected = [
        np.mean([1 + np.sum(row > row[method]) + (np.sum(row == row[method]) - 1) / 2 for row in scores])
        for method in range(scores.shape[1])
    ]
    np.testing.assert_allclose(average_ranks(scores), expected, rtol=1e-12)


@given(tables)
def test_ranks_ignore_the_order_of_tasks_and_follow_that_of_methods(scores: np.ndarray) -> None:
    tasks, methods = (np.random.default_rng(scores.size).permutation(size) for size in scores.shape)
    np.testing.assert_allclose(average_ranks(scores[tasks][:, methods]), average_ranks(scores)[methods], rtol=1e-12)


@given(tables)
def test_ranks_keep_under_increasing_maps_and_sum_to_a_constant(scores: np.ndarray) -> None:
    np.testing.assert_allclose(average_ranks(np.exp(scores)), average_ranks(scores))
    methods = scores.shape[1]
    assert average_ranks(scores).sum() == pytest.approx(methods * (methods + 1) / 2)


def test_friedmans_statistic_without_ties() -> None:
    """χ² = 12 N / (k (k + 1)) · (Σ R² - k (k + 1)² / 4), Demšar 2006, section 3.2.2."""
    scores = np.random.default_rng(0).normal([0.0, 0.5, 1.0, 1.5], size=(9, 4))
    tasks, methods = scores.shape
    mean_ranks = average_ranks(scores)
    statistic = 12 * tasks / (methods * (methods + 1)) * ((mean_ranks**2).sum() - methods * (methods + 1) ** 2 / 4)
    assert friedman_test(scores) == pytest.approx(chi2.sf(statistic, methods - 1), rel=1e-10)


def test_friedmans_test_with_ties_is_scipys() -> None:
    scores = np.random.default_rng(1).integers(0, 4, (8, 5)).astype(float)
    assert friedman_test(scores) == pytest.approx(friedmanchisquare(*scores.T).pvalue, rel=1e-10)


def test_friedmans_edges() -> None:
    assert friedman_test(np.ones((5, 2))) is None
    assert friedman_test(np.ones((1, 5))) is None
    assert friedman_test(np.tile(np.arange(4.0)[:, None], (1, 3))) == 1.0


@pytest.mark.parametrize(
    ("methods", "quantile"),
    [
        (2, 1.960),
        (3, 2.343),
        (4, 2.569),
        (5, 2.728),
        (6, 2.850),
        (7, 2.949),
        (8, 3.031),
        (9, 3.102),
        (10, 3.164),
    ],
)
def test_the_quantiles_of_demsars_table(methods: int, quantile: float) -> None:
    """Demšar 2006, table 5(a): quantiles of the Studentized range in three decimals, over √2."""
    unit = math.sqrt(methods * (methods + 1) / (6 * 14))
    in_range = critical_difference(methods, tasks=14) / unit * math.sqrt(2)
    assert round(round(in_range, 3) / math.sqrt(2), 3) == quantile


def test_demsars_example() -> None:
    """Demšar 2006, section 3.2.2: four classifiers on 14 data sets, CD 1.25."""
    assert critical_difference(4, 14) == pytest.approx(1.25, abs=0.005)


def test_the_critical_difference_shrinks_with_tasks_and_alpha() -> None:
    assert critical_difference(5, 6) == pytest.approx(2 * critical_difference(5, 24))
    assert critical_difference(5, 6, alpha=0.1) < critical_difference(5, 6, alpha=0.05)


@given(ranks, st.sampled_from([0.05, 0.75, 2.0, 10.0]))
def test_groups_are_the_maximal_sets_within_the_difference(ranks: list[float], difference: float) -> None:
    """By search: among all sets of two or more that are close enough, those in no larger one."""
    close = [
        set(chosen)
        for size in range(2, len(ranks) + 1)
        for chosen in combinations(range(len(ranks)), size)
        if max(ranks[method] for method in chosen) - min(ranks[method] for method in chosen) < difference
    ]
    maximal = [one for one in close if not any(one < other for other in close)]
    found = groups(ranks, difference)
    assert sorted(map(sorted, found)) == sorted(map(sorted, maximal))
    for group in found:
        assert [ranks[method] for method in group] == sorted(ranks[method] for method in group)


def test_groups_overlap_and_may_be_none() -> None:
    assert groups([3.0, 1.0, 2.0], 1.5) == [(1, 2), (2, 0)]
    assert groups([1.0, 2.0, 3.0], 1.0) == []
    assert groups([1.0], 1.0) == []


@pytest.mark.parametrize("wrong", [np.zeros(3), np.zeros((0, 3)), np.array([[1.0, math.nan]])])
def test_scores_that_are_no_table_are_an_error(wrong: np.ndarray) -> None:
    for function in (average_ranks, friedman_test):
        with pytest.raises(ValueError, match="finite scores"):
            function(wrong)


@pytest.mark.parametrize(("methods", "tasks", "alpha"), [(1, 5, 0.05), (3, 0, 0.05), (3, 5, 0.0)])
def test_a_critical_difference_of_nothing_is_an_error(methods: int, tasks: int, alpha: float) -> None:
    with pytest.raises(ValueError, match=r"critical difference|alpha"):
        critical_difference(methods, tasks, alpha)
