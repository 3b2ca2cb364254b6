from __future__ import annotations

import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lfobench.stats.summary import Summary, summarize

scores = st.floats(min_value=-1e3, max_value=1e3)


@given(st.lists(scores, min_size=2, max_size=12))
def test_mean_and_sample_standard_deviation(samples: list[float]) -> None:
    summary = summarize(samples)
    assert summary.n == len(samples)
    assert summary.mean == pytest.approx(statistics.fmean(samples), rel=1e-9, abs=1e-9)
    assert summary.std == pytest.approx(statistics.stdev(samples), rel=1e-6, abs=1e-9)


def test_one_sample_has_no_standard_deviation() -> None:
    assert summarize([42.0]) == Summary(1, 42.0, None)


@given(scores, st.integers(min_value=2, max_value=9))
def test_equal_samples_have_a_standard_deviation_of_exactly_zero(score: float, n: int) -> None:
    assert summarize([score] * n) == Summary(n, score, 0.0)


@pytest.mark.parametrize("samples", [[], [1.0, math.nan], [math.inf]])
def test_nothing_to_summarize_is_an_error(samples: list[float]) -> None:
    with pytest.raises(ValueError, match="finite"):
        summarize(samples)
