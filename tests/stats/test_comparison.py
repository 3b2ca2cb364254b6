"""Every test by its name against SciPy, and what all of them have in common."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import get_args

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import stats

from lfobench.stats.intervals import Summary
from lfobench.stats.options import Test
from lfobench.stats.tests import FROM_SUMMARIES, PAIRED, Sample, p_value, sample_of, student_test, welch_test

EVERY_TEST: tuple[Test, ...] = get_args(Test)
UNPAIRED = [test for test in EVERY_TEST if test not in PAIRED]
T_TESTS = ("welch", "student", "paired-t")

# Scores on a grid of 0.001: no property is lost to cancellation in differences of nearly equal numbers.
scores = st.integers(min_value=-20_000, max_value=130_000).map(lambda thousandths: thousandths / 1000)
samples = st.lists(scores, min_size=2, max_size=5)
varied = samples.filter(lambda values: len(set(values)) > 1)


@st.composite
def compared(draw: st.DrawFn, test: Test, values: st.SearchStrategy[float] = scores) -> tuple[list[float], list[float]]:
    """Two sides of a few scores, of unequal size where the test allows it."""
    first = draw(st.lists(values, min_size=2, max_size=5))
    size = {"min_size": len(first), "max_size": len(first)} if test in PAIRED else {"min_size": 2, "max_size": 5}
    return first, draw(st.lists(values, **size))


def sample(test: Test, values: list[float]) -> Sample:
    """The values as what the test compares: of seeds, or of start states."""
    return sample_of([0.0], values) if test in PAIRED else sample_of(values)


def p_of(test: Test, first: list[float], second: list[float]) -> float | None:
    return p_value(test, sample(test, first), sample(test, second))


def without_spread(test: Test, first: list[float], second: list[float]) -> bool:
    """Whether what the test looks at does not vary; on the grid, so that rounding is no spread."""
    if test in PAIRED:
        return len({round(1000 * one) - round(1000 * two) for one, two in zip(first, second, strict=True)}) == 1
    return len(set(first)) == len(set(second)) == 1


# --- references ------------------------------------------------------------------------------------------------------


def permuted(first: list[float], second: list[float]) -> float:
    def distance(x: np.ndarray, y: np.ndarray, axis: int) -> np.ndarray:
        return np.abs(x.mean(axis) - y.mean(axis))

    return float(
        stats.permutation_test(
            (first, second), distance, vectorized=True, n_resamples=np.inf, alternative="greater"
        ).pvalue
    )


def flipped(first: list[float], second: list[float]) -> float:
    def distance(x: np.ndarray, y: np.ndarray, axis: int) -> np.ndarray:
        return np.abs((x - y).mean(axis))

    return float(
        stats.permutation_test(
            (first, second),
            distance,
            permutation_type="samples",
            vectorized=True,
            n_resamples=np.inf,
            alternative="greater",
        ).pvalue
    )


REFERENCES: dict[Test, Callable[[list[float], list[float]], float]] = {
    "welch": lambda first, second: stats.ttest_ind(first, second, equal_var=False).pvalue,
    "student": lambda first, second: stats.ttest_ind(first, second, equal_var=True).pvalue,
    "mann-whitney": lambda first, second: stats.mannwhitneyu(first, second, method="exact").pvalue,
    "permutation": permuted,
    "paired-t": lambda first, second: stats.ttest_rel(first, second).pvalue,
    "wilcoxon": lambda first, second: stats.wilcoxon(first, second, method="exact").pvalue,
    "paired-permutation": flipped,
}


@pytest.mark.parametrize("test", EVERY_TEST)
@pytest.mark.parametrize(("n", "m"), [(2, 2), (5, 5), (7, 7), (3, 6), (8, 2)])
def test_agrees_with_scipy(test: Test, n: int, m: int) -> None:
    """Continuous scores, so that nothing ties; ties are the business of the tests of `permutation`."""
    random = np.random.default_rng([n, m])
    for shift in (0.0, 3.0, 20.0):
        first = random.normal(60.0, 10.0, n).tolist()
        second = random.normal(60.0 + shift, 4.0, n if test in PAIRED else m).tolist()
        assert p_of(test, first, second) == pytest.approx(REFERENCES[test](first, second), rel=1e-10, abs=1e-10)


@settings(max_examples=60)
@given(varied, varied)
def test_t_tests_agree_with_scipy_on_any_scores(first: list[float], second: list[float]) -> None:
    for test in ("welch", "student"):
        expected = REFERENCES[test](first, second)
        assert p_of(test, first, second) == pytest.approx(expected, rel=1e-6, abs=1e-12)


# --- what all tests have in common -----------------------------------------------------------------------------------


@pytest.mark.parametrize("test", EVERY_TEST)
@settings(max_examples=25)
@given(data=st.data())
def test_is_a_probability_and_symmetric_in_the_sides(test: Test, data: st.DataObject) -> None:
    first, second = data.draw(compared(test))
    p = p_of(test, first, second)
    assert p is not None
    assert 0.0 < p <= 1.0 or (p == 0.0 and test in T_TESTS and without_spread(test, first, second))
    assert p_of(test, second, first) == pytest.approx(p, rel=1e-9)


@pytest.mark.parametrize("test", EVERY_TEST)
@settings(max_examples=25)
@given(data=st.data())
def test_does_not_depend_on_order(test: Test, data: st.DataObject) -> None:
    first, second = data.draw(compared(test))
    if test in PAIRED:
        reordered = data.draw(st.permutations(list(zip(first, second, strict=True))))
        one, two = [list(side) for side in zip(*reordered, strict=True)]
    else:
        one, two = data.draw(st.permutations(first)), data.draw(st.permutations(second))
    assert p_of(test, one, two) == pytest.approx(p_of(test, first, second), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("test", EVERY_TEST)
@settings(max_examples=25)
@given(data=st.data(), shift=st.integers(-100, 100), scale=st.sampled_from([1e-3, 0.5, 3.0, 1e6]))
def test_does_not_depend_on_unit_and_origin(test: Test, data: st.DataObject, shift: int, scale: float) -> None:
    first, second = data.draw(compared(test))
    # Differences that are equal but for rounding have a p between the limits of 0 and 1.
    assume(test != "paired-t" or not without_spread(test, first, second))
    moved = [[scale * (value + shift) for value in side] for side in (first, second)]
    assert p_of(test, *moved) == pytest.approx(p_of(test, first, second), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("test", EVERY_TEST)
def test_no_difference_is_no_evidence(test: Test) -> None:
    for values in ([3.0, 4.5, 5.0, 4.0], [50.0, 50.0, 50.0], [0.0, 0.0]):
        assert p_of(test, values, values) == pytest.approx(1.0)


@pytest.mark.parametrize("test", EVERY_TEST)
def test_without_any_spread_on_either_side(test: Test) -> None:
    """A t-test takes the limit; the others count the labellings, 2 of C(10, 5) and 2 of 2^5."""
    p = p_of(test, [50.0] * 5, [0.0] * 5)
    expected = 0.0 if test in T_TESTS else 2 / 252 if test in ("mann-whitney", "permutation") else 2 / 32
    assert p == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("test", EVERY_TEST)
def test_a_single_score_cannot_be_tested(test: Test) -> None:
    assert p_of(test, [1.0], [2.0]) is None
    if test not in PAIRED:
        assert p_of(test, [100.0], [1.0, 2.0, 3.0]) is None
        assert p_of(test, [1.0, 2.0, 3.0], [100.0]) is None


@pytest.mark.parametrize("test", sorted(PAIRED))
def test_paired_tests_need_the_same_starts(test: Test) -> None:
    with pytest.raises(ValueError, match=f"'{test}' pairs start states, but one method has 3 and the other 2"):
        p_of(test, [1.0, 2.0, 3.0], [1.0, 2.0])


@pytest.mark.parametrize("test", EVERY_TEST)
def test_what_a_published_summary_is_enough_for(test: Test) -> None:
    published, ours = Sample(Summary(5, 90.0, 1.0)), sample_of([1.0, 2.0], [1.0, 2.0])
    for first, second in ((published, ours), (ours, published)):
        if test in FROM_SUMMARIES:
            assert p_value(test, first, second) is not None
        else:
            with pytest.raises(ValueError, match=f"'{test}' needs .*, not a summary"):
                p_value(test, first, second)


@pytest.mark.parametrize("test", sorted(PAIRED))
def test_seeds_alone_are_not_enough_for_a_paired_test(test: Test) -> None:
    with pytest.raises(ValueError, match=f"'{test}' needs start states"):
        p_value(test, sample_of([1.0, 2.0]), sample_of([1.0, 2.0]))


def test_unpaired_tests_look_at_seeds_and_paired_ones_at_starts() -> None:
    """One seed on each side: only the starts can be tested."""
    first, second = sample_of([50.0], [49.0, 50.5, 50.5]), sample_of([40.0], [39.5, 40.5, 40.0])
    assert {test for test in EVERY_TEST if p_value(test, first, second) is not None} == PAIRED


@pytest.mark.parametrize("test", ["welch", "student", "paired-t"])
@settings(max_examples=25)
@given(values=varied, shift=st.floats(min_value=1.0, max_value=50.0))
def test_a_larger_difference_is_more_significant(test: Test, values: list[float], shift: float) -> None:
    noise = [0.5, -0.25, 0.0, 0.25, -0.5][: len(values)]
    near = p_of(test, values, [value + wobble + shift for value, wobble in zip(values, noise, strict=True)])
    far = p_of(test, values, [value + wobble + 2 * shift for value, wobble in zip(values, noise, strict=True)])
    assert far is not None and near is not None
    assume(1e-12 < near < 1.0)
    assert far < near


# --- edges of the t-tests --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("t_test", [welch_test, student_test])
def test_summaries_without_spread(t_test: Callable[[Summary, Summary], float | None]) -> None:
    assert t_test(Summary(5, 0.0, 0.0), Summary(5, 50.0, 0.0)) == 0.0
    assert t_test(Summary(5, 50.0, 0.0), Summary(3, 50.0, 0.0)) == 1.0
    assert t_test(Summary(5, 1.0, 0.5), Summary(1, 100.0, None)) is None
    assert t_test(Summary(5, 1.0, 1e-170), Summary(5, 1.0, 3e-170)) == pytest.approx(1.0)


def test_zero_spread_on_one_side_is_a_one_sample_test() -> None:
    values = [3.0, 4.5, 5.0, 4.0]
    expected = stats.ttest_1samp(values, 2.0).pvalue
    assert p_of("welch", values, [2.0, 2.0, 2.0]) == pytest.approx(expected)


def test_pairs_with_one_difference_are_told_apart_by_it() -> None:
    assert p_of("paired-t", [1.0, 2.0, 3.0], [0.5, 1.5, 2.5]) == 0.0
    assert p_of("paired-permutation", [1.0, 2.0, 3.0], [0.5, 1.5, 2.5]) == 2 / 8


def test_a_published_pair() -> None:
    """Table 1 of arXiv:2406.08805v2, random+expert halfcheetah: DILO against SMODICE at n = 5."""
    p = p_value("welch", Sample(Summary(5, 91.18, 0.24)), Sample(Summary(5, 85.16, 3.62)))
    assert p == pytest.approx(0.0205, abs=5e-4)


def test_scipy_is_not_imported_before_a_test_is_made() -> None:
    code = "import sys, lfobench.tables.exporters.html, lfobench.tables.building; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
