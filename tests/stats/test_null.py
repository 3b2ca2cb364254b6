from __future__ import annotations

import math

import numpy as np
import pytest
from self_test import false_highlight_rate

from lfobench.stats.intervals import summarize
from lfobench.stats.successes import wilson_interval
from lfobench.stats.tests import welch_test


def best_against_second(scores: np.ndarray) -> bool:
    second, best = sorted((summarize(row.tolist()) for row in scores), key=lambda summary: summary.mean)[-2:]
    p = welch_test(best, second)
    return p is not None and p < 0.05


def test_a_rule_with_a_known_level_has_that_rate() -> None:
    """The difference of two means of n standard normal scores is normal with variance 2 / n."""
    estimate = false_highlight_rate(
        lambda scores: abs(scores[0].mean() - scores[1].mean()) > 1.959964 * math.sqrt(2 / scores.shape[1]), 2, 5, 8000
    )
    assert estimate.value == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / 8000))


@pytest.mark.parametrize(("methods", "rate"), [(2, 0.045), (3, 0.017)])
def test_best_against_second_is_conservative(methods: int, rate: float) -> None:
    """Measured once with many more rows; the more methods, the closer the second best comes."""
    rows = 2000
    estimate = false_highlight_rate(best_against_second, methods, seeds=5, rows=rows)
    assert estimate.value == pytest.approx(rate, abs=4 * math.sqrt(rate * (1 - rate) / rows))


def test_the_interval_is_that_of_the_rate() -> None:
    seen = []

    def every_third(scores: np.ndarray) -> bool:
        seen.append(scores)
        return len(seen) % 3 == 0

    estimate = false_highlight_rate(every_third, methods=4, seeds=3, rows=30, level=0.9)
    assert estimate.value == pytest.approx(1 / 3)
    assert estimate.interval == wilson_interval(10, 30, 0.9)
    assert {scores.shape for scores in seen} == {(4, 3)}


def test_rows_are_decided_by_the_seed_and_extend() -> None:
    def rows_of(rows: int, seed: int) -> np.ndarray:
        seen: list[np.ndarray] = []
        false_highlight_rate(lambda scores: bool(seen.append(scores)), 2, 3, rows=rows, seed=seed)
        return np.array(seen)

    np.testing.assert_array_equal(rows_of(20, 1)[:5], rows_of(5, 1))
    assert not np.isin(rows_of(5, 1), rows_of(5, 2)).any()


@pytest.mark.parametrize(("methods", "seeds", "rows"), [(0, 5, 10), (2, 0, 10), (2, 5, 0)])
def test_nothing_to_simulate_is_an_error(methods: int, seeds: int, rows: int) -> None:
    with pytest.raises(ValueError, match="methods, seeds and rows"):
        false_highlight_rate(lambda scores: True, methods, seeds, rows)
