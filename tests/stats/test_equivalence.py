from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import ttest_ind

from lfobench.stats.intervals import Summary, equivalence_test, summarize
from lfobench.stats.tests import welch_test

means = st.integers(0, 100_000).map(lambda thousandths: thousandths / 1000)
spreads = st.integers(1, 20_000).map(lambda thousandths: thousandths / 1000)
summaries = st.builds(Summary, st.integers(2, 12), means, spreads)
margins = st.sampled_from([0.5, 5.0, 20.0])


def test_p_is_the_larger_of_two_one_sided_welch_tests() -> None:
    random = np.random.default_rng(0)
    for n, m, shift in [(3, 5, 0.0), (5, 5, 4.0), (10, 4, -3.0), (2, 2, 30.0)]:
        first, second = random.normal(50 + shift, 2, n), random.normal(50, 6, m)
        above = ttest_ind(first + 5.0, second, equal_var=False, alternative="greater").pvalue
        below = ttest_ind(first - 5.0, second, equal_var=False, alternative="less").pvalue
        result = equivalence_test(summarize(first.tolist()), summarize(second.tolist()), 5.0)
        assert result.p == pytest.approx(max(above, below), rel=1e-10)
        assert result.difference == pytest.approx(first.mean() - second.mean(), rel=1e-12)


@given(summaries, summaries, margins, st.sampled_from([0.01, 0.05, 0.2]))
def test_the_agreement_follows_the_interval_and_the_welch_test(
    first: Summary, second: Summary, margin: float, alpha: float
) -> None:
    result = equivalence_test(first, second, margin, alpha)
    different = welch_test(first, second)
    assert result.p is not None and result.interval is not None and different is not None
    assume(abs(result.p - alpha) > 1e-9 and abs(different - alpha) > 1e-9)
    assert result.interval.level == pytest.approx(1 - 2 * alpha)
    inside = -margin < result.interval.low and result.interval.high < margin
    expected = "matches" if inside else "differs" if different < alpha else "undecided"
    assert result.agreement == expected
    assert (result.p < alpha) == inside


@given(summaries, summaries, margins)
def test_swapping_the_sides_changes_the_sign_only(first: Summary, second: Summary, margin: float) -> None:
    one, other = equivalence_test(first, second, margin), equivalence_test(second, first, margin)
    assert (one.p, one.agreement, one.difference) == (pytest.approx(other.p), other.agreement, -other.difference)


@given(summaries, summaries)
def test_a_wider_margin_is_easier_to_show(first: Summary, second: Summary) -> None:
    p = [equivalence_test(first, second, margin).p for margin in (1.0, 5.0, 25.0)]
    assert p == sorted(p, reverse=True)


def test_verdicts() -> None:
    published = Summary(5, 90.0, 1.0)
    assert equivalence_test(Summary(5, 91.0, 1.0), published, 5.0).agreement == "matches"
    assert equivalence_test(Summary(5, 60.0, 1.0), published, 5.0).agreement == "differs"
    assert equivalence_test(Summary(5, 80.0, 30.0), published, 5.0).agreement == "undecided"


def test_a_significant_difference_inside_the_margin_matches() -> None:
    first, second = Summary(5, 91.0, 0.1), Summary(5, 90.0, 0.1)
    different = welch_test(first, second)
    assert different is not None and different < 1e-4
    assert equivalence_test(first, second, 5.0).agreement == "matches"


@pytest.mark.parametrize(("first", "second"), [(1, 5), (5, 1), (1, 1)])
def test_one_sample_is_undecided(first: int, second: int) -> None:
    sides = [Summary(n, 50.0, 1.0 if n > 1 else None) for n in (first, second)]
    result = equivalence_test(sides[0], sides[1], 5.0)
    assert (result.p, result.interval, result.agreement, result.difference) == (None, None, "undecided", 0.0)


@pytest.mark.parametrize(
    ("mean", "p", "agreement"),
    [(50.0, 0.0, "matches"), (54.0, 0.0, "matches"), (55.0, 0.5, "differs"), (60.0, 1.0, "differs")],
)
def test_without_spread_the_limit_decides(mean: float, p: float, agreement: str) -> None:
    """The same as for ever smaller spreads."""
    for std in (0.0, 1e-9):
        result = equivalence_test(Summary(5, mean, std), Summary(5, 50.0, std), 5.0)
        assert (result.p, result.agreement) == (pytest.approx(p, abs=1e-12), agreement)


@pytest.mark.parametrize("margin", [0.0, -1.0, math.inf, math.nan])
def test_a_margin_is_positive_and_finite(margin: float) -> None:
    with pytest.raises(ValueError, match="margin"):
        equivalence_test(Summary(5, 1.0, 1.0), Summary(5, 1.0, 1.0), margin)


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_alpha_leaves_room_for_an_interval(alpha: float) -> None:
    with pytest.raises(ValueError, match="alpha"):
        equivalence_test(Summary(5, 1.0, 1.0), Summary(5, 1.0, 1.0), 5.0, alpha)


def test_means_a_margin_apart_match_as_often_as_alpha() -> None:
    """At the edge of the margin, with a spread small against it, the test has its level."""
    random = np.random.default_rng(2)
    rows = 1500
    matches = 0
    for first, second in zip(random.normal(55.0, 1.0, (rows, 5)), random.normal(50.0, 1.0, (rows, 5)), strict=True):
        result = equivalence_test(summarize(first.tolist()), summarize(second.tolist()), 5.0)
        matches += result.agreement == "matches"
    assert matches / rows == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / rows))
