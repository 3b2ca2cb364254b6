"""Every two-sided test against SciPy or a plain enumeration."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from lfobench.stats.comparison import FROM_SUMMARIES, PAIRED, p_value
from lfobench.stats.names import Test
from lfobench.stats.sample import Sample, sample_of

Vector = NDArray[np.float64]
SEEDED: tuple[Test, ...] = ("welch", "student", "mann-whitney", "permutation")
ALL: tuple[Test, ...] = (*SEEDED, *sorted(PAIRED))
ROUNDING = 1e-9

# A coarse grid makes ties between sums common, and exact in floating point.
grid = st.integers(-40, 40).map(lambda quarter: quarter / 4)
few = st.lists(grid, min_size=2, max_size=6)


def seeds(values: list[float] | Vector) -> Sample:
    return sample_of([float(value) for value in values])


def starts(values: list[float] | Vector) -> Sample:
    return sample_of([0.0, 1.0], [float(value) for value in values])


def by_enumeration(first: list[float], second: list[float]) -> float:
    both = first + second
    mean = sum(both) / len(both)
    sums = [abs(sum(both[index] - mean for index in group)) for group in combinations(range(len(both)), len(first))]
    return sum(value >= sums[0] - ROUNDING for value in sums) / len(sums)


def by_signs(differences: list[float]) -> float:
    patterns = product((1, -1), repeat=len(differences))
    sums = [abs(sum(sign * value for sign, value in zip(signs, differences, strict=True))) for signs in patterns]
    return sum(value >= sums[0] - ROUNDING for value in sums) / len(sums)


@given(few, few)
@settings(max_examples=60)
def test_permutation_counts_every_relabelling(first: list[float], second: list[float]) -> None:
    assert p_value("permutation", seeds(first), seeds(second)) == pytest.approx(
        by_enumeration(first, second), abs=1e-12
    )


@given(few, few)
@settings(max_examples=60)
def test_mann_whitney_with_ties_counts_every_relabelling_of_mid_ranks(first: list[float], second: list[float]) -> None:
    ranks = stats.rankdata(first + second).tolist()
    expected = by_enumeration(ranks[: len(first)], ranks[len(first) :])
    assert p_value("mann-whitney", seeds(first), seeds(second)) == pytest.approx(expected, abs=1e-12)


@given(st.lists(grid, min_size=2, max_size=8))
@settings(max_examples=60)
def test_paired_permutation_counts_every_sign(differences: list[float]) -> None:
    zero = [0.0] * len(differences)
    found = p_value("paired-permutation", starts(differences), starts(zero))
    assert found == pytest.approx(by_signs(differences), abs=1e-12)


@given(st.lists(grid, min_size=2, max_size=8))
@settings(max_examples=60)
def test_wilcoxon_with_ties_counts_every_sign_of_mid_ranks(differences: list[float]) -> None:
    kept = [value for value in differences if value]
    ranks = stats.rankdata(np.abs(kept)) if kept else []
    expected = (
        by_signs([float(np.sign(value) * rank) for value, rank in zip(kept, ranks, strict=True)]) if kept else 1.0
    )
    found = p_value("wilcoxon", starts(differences), starts([0.0] * len(differences)))
    assert found == pytest.approx(expected, abs=1e-12)


def scipy_permutation(first: Vector, second: Vector) -> float:
    def statistic(one: Vector, two: Vector, axis: int) -> Vector:
        return np.asarray(one.mean(axis=axis) - two.mean(axis=axis))

    found = stats.permutation_test((first, second), statistic, vectorized=True, n_resamples=np.inf)
    return float(found.pvalue)


@pytest.mark.parametrize(
    ("test", "reference"),
    [
        ("welch", lambda one, two: stats.ttest_ind(one, two, equal_var=False).pvalue),
        ("student", lambda one, two: stats.ttest_ind(one, two).pvalue),
        ("mann-whitney", lambda one, two: stats.mannwhitneyu(one, two, method="exact").pvalue),
        ("permutation", scipy_permutation),
    ],
)
@pytest.mark.parametrize("sizes", [(5, 5), (7, 7), (3, 6)])
def test_unpaired_tests_agree_with_scipy(
    test: Test, reference: Callable[[Vector, Vector], float], sizes: tuple[int, int]
) -> None:
    if test == "permutation" and sizes[0] != sizes[1]:
        pytest.skip("SciPy doubles the smaller tail; ours counts both, which is the same only for equal sizes")
    generator = np.random.default_rng(3)
    for shift in (0.0, 1.0, 4.0):
        first, second = generator.normal(shift, 1.0, sizes[0]), generator.normal(0.0, 2.0, sizes[1])
        assert p_value(test, seeds(first), seeds(second)) == pytest.approx(reference(first, second), rel=1e-10)


@pytest.mark.parametrize("count", [3, 10, 16])
def test_paired_tests_agree_with_scipy(count: int) -> None:
    generator = np.random.default_rng(4)
    for shift in (0.0, 1.0):
        first, second = generator.normal(shift, 1.0, count), generator.normal(0.0, 1.0, count)
        one, two = starts(first), starts(second)
        assert p_value("paired-t", one, two) == pytest.approx(stats.ttest_rel(first, second).pvalue, rel=1e-10)
        expected = stats.wilcoxon(first, second, mode="exact").pvalue
        assert p_value("wilcoxon", one, two) == pytest.approx(expected, rel=1e-10)


def test_beyond_what_can_be_listed() -> None:
    generator = np.random.default_rng(5)
    first, second = generator.normal(0.5, 1.0, 15), generator.normal(0.0, 1.0, 15)
    rank = p_value("mann-whitney", seeds(first), seeds(second))
    assert rank == pytest.approx(stats.mannwhitneyu(first, second, method="asymptotic").pvalue, rel=1e-10)
    random = p_value("permutation", seeds(first), seeds(second))
    assert random == p_value("permutation", seeds(first), seeds(second)), "the same data give the same p"
    student = stats.ttest_ind(first, second).pvalue
    # 100,000 relabellings: four standard errors are 0.007 at most; the t-test is close to what they estimate.
    assert random == pytest.approx(student, abs=0.02)
    pairs = p_value("wilcoxon", starts(generator.normal(0.3, 1.0, 30)), starts(np.zeros(30)))
    assert pairs is not None and 0.0 < pairs <= 1.0
    flips = p_value("paired-permutation", starts(first - second), starts(np.zeros(15)))
    assert flips == pytest.approx(stats.ttest_rel(first, second).pvalue, abs=0.02)


def as_sample(test: Test, values: list[float]) -> Sample:
    return starts(values) if test in PAIRED else seeds(values)


@pytest.mark.parametrize("test", ALL)
@given(data=st.data())
@settings(max_examples=25)
def test_order_sides_and_origin_do_not_matter(test: Test, data: st.DataObject) -> None:
    pairs = data.draw(st.lists(st.tuples(grid, grid), min_size=2, max_size=6))
    first, second = [one for one, _ in pairs], [two for _, two in pairs]
    p = p_value(test, as_sample(test, first), as_sample(test, second))
    assert p is not None and 0.0 <= p <= 1.0
    assert p_value(test, as_sample(test, second), as_sample(test, first)) == pytest.approx(p, rel=1e-9)
    shuffled = data.draw(st.permutations(pairs))
    again = [as_sample(test, [pair[side] for pair in shuffled]) for side in (0, 1)]
    assert p_value(test, *again) == pytest.approx(p, rel=1e-9)
    moved = [as_sample(test, [8.0 * value + 3.0 for value in side]) for side in (first, second)]
    assert p_value(test, *moved) == pytest.approx(p, rel=1e-9)


@pytest.mark.parametrize("test", ALL)
def test_one_score_on_a_side_is_no_test(test: Test) -> None:
    alone = sample_of([1.0], [1.0])
    other = alone if test in PAIRED else sample_of([1.0, 2.0, 3.0])
    assert p_value(test, alone, other) is None


@pytest.mark.parametrize("test", ALL)
def test_no_spread_on_either_side(test: Test) -> None:
    flat = sample_of([5.0] * 4, [5.0] * 4)
    assert p_value(test, flat, flat) == 1.0
    apart = p_value(test, flat, sample_of([9.0] * 4, [9.0] * 4))
    expected = {"welch": 0.0, "student": 0.0, "paired-t": 0.0, "mann-whitney": 2 / 70, "permutation": 2 / 70}
    assert apart == pytest.approx(expected.get(test, 2 / 16))


def test_what_a_summary_cannot_answer_is_refused() -> None:
    summary = Sample(sample_of([1.0, 2.0]).summary)
    for test in ALL:
        if test in FROM_SUMMARIES:
            assert p_value(test, summary, summary) == 1.0
        else:
            with pytest.raises(ValueError, match="not a summary"):
                p_value(test, summary, summary)


def test_pairs_need_the_same_starts() -> None:
    with pytest.raises(ValueError, match="one side has 2 and the other 3"):
        p_value("paired-t", starts([1.0, 2.0]), starts([1.0, 2.0, 3.0]))
