from __future__ import annotations

import math

import pytest

from lfobench.stats.intervals import Summary
from lfobench.stats.tests import Sample, sample_of


def test_a_sample_keeps_every_score_beside_its_summary() -> None:
    assert sample_of([1.0, 3.0], [0.0, 2.0, 4.0]) == Sample(
        Summary(2, 2.0, pytest.approx(math.sqrt(2))), (1.0, 3.0), (0.0, 2.0, 4.0)
    )
    assert sample_of([5.0]) == Sample(Summary(1, 5.0, None), (5.0,), ())


@pytest.mark.parametrize(("seeds", "starts"), [([], []), ([math.nan], []), ([1.0], [1.0, math.inf])])
def test_scores_are_finite_and_there_is_one(seeds: list[float], starts: list[float]) -> None:
    with pytest.raises(ValueError, match="finite"):
        sample_of(seeds, starts)
