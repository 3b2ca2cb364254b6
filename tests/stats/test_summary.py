from __future__ import annotations

import math
import statistics
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lfobench.score import tie
from lfobench.stats.intervals import Summary, difference, summarize

scores = st.floats(min_value=-1e3, max_value=1e3)


@given(st.lists(scores, min_size=2, max_size=12))
def test_mean_and_sample_standard_deviation(samples: list[float]) -> None:
    summary = summarize(samples)
    assert summary.n == len(samples)
    assert summary.mean == pytest.approx(statistics.fmean(samples), rel=1e-9, abs=1e-9)
    spread = 0.0 if max(samples) - min(samples) <= tie(samples) else statistics.stdev(samples)
    assert summary.std == pytest.approx(spread, rel=1e-6, abs=1e-9)


def test_one_sample_has_no_standard_deviation() -> None:
    assert summarize([42.0]) == Summary(1, 42.0, None)


@given(scores, st.integers(min_value=2, max_value=9))
def test_equal_samples_have_a_standard_deviation_of_exactly_zero(score: float, n: int) -> None:
    assert summarize([score] * n) == Summary(n, score, 0.0)


@pytest.mark.parametrize("samples", [[], [1.0, math.nan], [math.inf]])
def test_nothing_to_summarize_is_an_error(samples: list[float]) -> None:
    with pytest.raises(ValueError, match="finite"):
        summarize(samples)


@given(st.lists(scores, min_size=2, max_size=9), st.randoms())
def test_the_order_of_samples_plays_no_part(samples: list[float], random: Random) -> None:
    shuffled = random.sample(samples, len(samples))
    assert summarize(shuffled) == summarize(samples)


def test_what_rounding_alone_makes_is_no_spread_and_no_difference() -> None:
    """A sum of tenths in two orders; a shift of a billionth of a point; the same beside a huge offset."""
    one, other = 0.1 + 0.2 + 0.3, 0.3 + 0.2 + 0.1
    assert one != other
    assert summarize([one, other, one]).std == 0.0
    assert difference(summarize([one] * 3), summarize([other] * 3)) == 0.0
    assert difference(Summary(3, 30.3, 0.0), Summary(3, 30.3 + 1e-9, 0.0)) == 0.0
    assert difference(Summary(3, 1e9, 4.0), Summary(3, 1e9 + 1e-6, 4.0)) == 0.0
    assert difference(Summary(3, 30.3, 0.0), Summary(3, 30.3001, 0.0)) == pytest.approx(-1e-4)
    assert difference(Summary(3, 1e9, 4.0), Summary(3, 1e9 + 1.0, 4.0)) == -1.0
    assert tie([0.0]) == 1e-8 and tie([1e9], [2e9]) == 2e-3


def test_a_common_offset_costs_no_digits() -> None:
    assert summarize([1e9 + each for each in (1.0, 2.0, 4.5)]) == Summary(
        3, 1e9 + 2.5, statistics.stdev([1.0, 2.0, 4.5])
    )


def test_the_largest_scores_have_a_mean_and_a_spread() -> None:
    largest = 1.7e308
    assert summarize([largest] * 7) == Summary(7, largest, 0.0)
    spread = summarize([largest, largest / 2.0])
    assert spread.mean == pytest.approx(0.75 * largest)
    assert spread.std == pytest.approx(largest / math.sqrt(8.0))
    assert summarize([1e200, -1e200, 0.0]).std == pytest.approx(1e200)
    with pytest.raises(ValueError, match=r"too far apart .* -1\.7e\+308 to 1\.7e\+308"):
        summarize([largest, -largest])
