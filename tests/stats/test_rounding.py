"""Differences of rounding size decide nothing: no test, no choice of the best, no verdict, no rank."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from lfobench.stats.aggregates import probability_of_improvement
from lfobench.stats.contrast import contrast
from lfobench.stats.highlight import Rule, highlights, places
from lfobench.stats.intervals import equivalence_test, welch_interval
from lfobench.stats.options import Test
from lfobench.stats.ranking import average_ranks, friedman_test
from lfobench.stats.tests import Sample, p_value, rank_sum_test, sample_of, signed_rank_test, without_spread

EVERY_TEST: tuple[Test, ...] = get_args(Test)
SPREAD = (28.25, 30.5, 33.75, 31.0)
CONSTANT = (30.3,) * 4


def noisy(scores: tuple[float, ...], size: float) -> tuple[float, ...]:
    return tuple(score + size * sign for score, sign in zip(scores, (1, 1, -1, 1), strict=True))


KINDS = {
    "one unit in the last place": (CONSTANT, noisy(CONSTANT, 7e-15)),
    "a billionth of a point": (CONSTANT, tuple(score + 1e-9 for score in CONSTANT)),
    "a billionth on scores that vary": (SPREAD, tuple(score + 1e-9 for score in SPREAD)),
    "noise on scores that vary": (SPREAD, noisy(SPREAD, 3e-14)),
    "about zero": (tuple(score - 30.3 for score in CONSTANT), noisy((0.0,) * 4, 4e-15)),
    "a huge common offset": (tuple(1e12 + each for each in SPREAD), noisy(tuple(1e12 + each for each in SPREAD), 2e-4)),
    "huge constants": ((1e12,) * 4, noisy((1e12,) * 4, 2e-4)),
}


def sample(scores: tuple[float, ...]) -> Sample:
    return sample_of(scores, scores)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("test", EVERY_TEST)
def test_level_sides_have_p_1_and_share_the_first_place(test: Test, kind: str) -> None:
    one, other = map(sample, KINDS[kind])
    for first, second in ((one, other), (other, one)):
        assert p_value(test, first, second) == 1.0
        (outcome,) = highlights([{"a": first, "b": second}], Rule(test, alpha=0.99))
        assert (outcome.outcome, outcome.methods, outcome.best, outcome.lost) == (
            "undecided",
            {"a", "b"},
            {"a", "b"},
            False,
        )
        (cell,) = contrast({"task": (first, second)}, Rule(test, alpha=0.99), 100).cells.values()
        assert (cell.outcome, cell.difference) == ("undecided", 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_ranks_and_chances_see_no_difference(kind: str) -> None:
    one, other = KINDS[kind]
    summaries = sample(one).summary, sample(other).summary
    interval = welch_interval(*summaries)
    assert interval is not None and interval.low == -interval.high
    assert equivalence_test(*summaries, margin=5.0).difference == 0.0
    assert probability_of_improvement([list(one)], [list(other)], replicates=10).value == 0.5
    table = np.array([[one[0], other[0], one[0]], [other[1], one[1], one[1]], [one[2], one[2], other[2]]])
    assert average_ranks(table).tolist() == [2.0, 2.0, 2.0]
    assert friedman_test(table) == 1.0


def test_level_methods_share_second_place_too() -> None:
    row = {
        "a": sample((90.0, 91.0, 92.0, 90.5)),
        **{name: sample(each) for name, each in zip("bc", KINDS["noise on scores that vary"], strict=True)},
    }
    assert [sorted(place) for place in places(row, "welch")] == [["a"], ["b", "c"]]
    (outcome,) = highlights([row], Rule(alpha=1e-9))
    assert outcome.methods == {"a", "b", "c"}


@pytest.mark.parametrize("test", EVERY_TEST)
def test_a_thousandth_of_a_point_is_a_difference(test: Test) -> None:
    """Twelve pairs and seeds, all ahead by as much: what a test makes of it is its own business."""
    one = tuple(30.0 + each for each in range(12))
    first, second = sample(tuple(each + 1e-3 for each in one)), sample(one)
    assert places({"a": first, "b": second}, test) == [["a"], ["b"]]
    p = p_value(test, first, second)
    assert p is not None
    assert p < 0.01 if test in ("paired-t", "wilcoxon", "paired-permutation") else p > 0.7


def test_ranks_of_many_level_scores_are_level() -> None:
    """Beyond what can be listed, too."""
    random = np.random.default_rng(0)
    noise = 1e-14 * random.standard_normal(40)
    assert rank_sum_test(50.0 + noise[:20], 50.0 + noise[20:]) == 1.0
    assert signed_rank_test(50.0 + noise[:20], 50.0 + noise[20:]) == 1.0


# --- without any spread -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("test", ["welch", "student", "paired-t"])
def test_a_limit_is_said_to_be_one(test: Test) -> None:
    flat, higher = sample(CONSTANT), sample(tuple(each + 1.0 for each in CONSTANT))
    assert p_value(test, higher, flat) == 0.0
    (outcome,) = highlights([{"a": higher, "b": flat}], Rule(test))
    assert (outcome.outcome, outcome.without_spread) == ("better", True)
    assert contrast({"task": (higher, flat)}, Rule(test), 10).cells["task"].without_spread


def test_spread_on_one_side_is_an_estimate_and_other_tests_need_none() -> None:
    flat, varied = sample(CONSTANT), sample(SPREAD)
    assert not any(without_spread(test, flat, varied) for test in EVERY_TEST)
    higher = sample(tuple(each + 1.0 for each in CONSTANT))
    assert {test for test in EVERY_TEST if without_spread(test, flat, higher)} == {"welch", "student", "paired-t"}
    shifted = sample(tuple(each + 1.0 for each in SPREAD))
    assert {test for test in EVERY_TEST if without_spread(test, varied, shifted)} == {"paired-t"}
