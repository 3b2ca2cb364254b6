from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import false_discovery_control

from lfobench.stats.highlight import adjusted
from lfobench.stats.options import Correction

# From 1e-12 on: products with a few rows neither underflow nor round to the same number.
p_values = st.lists(st.sampled_from([0.0, 0.004, 0.01, 0.05, 1.0]) | st.floats(1e-12, 1.0), min_size=1, max_size=12)
CORRECTIONS: tuple[Correction, ...] = ("none", "holm", "bh")


def holm_rejects(p: list[float], alpha: float) -> list[bool]:
    """Holm (1979): from the smallest p on, reject while p ≤ α / (number not yet rejected)."""
    rejected = [False] * len(p)
    for step, index in enumerate(sorted(range(len(p)), key=lambda index: p[index])):
        if p[index] > alpha / (len(p) - step):
            break
        rejected[index] = True
    return rejected


def bh_rejects(p: list[float], alpha: float) -> list[bool]:
    """Benjamini and Hochberg (1995): the k smallest, for the largest k with p_(k) ≤ k α / m."""
    order = sorted(range(len(p)), key=lambda index: p[index])
    largest = max((k for k in range(1, len(p) + 1) if p[order[k - 1]] <= k * alpha / len(p)), default=0)
    return [index in order[:largest] for index in range(len(p))]


@settings(max_examples=50)
@given(p_values, st.floats(0.001, 0.5))
def test_rejecting_the_adjusted_is_the_procedure(p: list[float], alpha: float) -> None:
    for correction, rejects in (("holm", holm_rejects), ("bh", bh_rejects)):
        found = adjusted(p, correction)  # type: ignore[arg-type]
        # Left of and right of each adjusted value the procedures must decide differently than at it.
        for level in (alpha, *(value * 1.001 for value in found), *(value * 0.999 for value in found)):
            if 0.0 < level <= 1.0:
                assert rejects(p, level) == [value <= level for value in found]


@settings(max_examples=50)
@given(p_values)
def test_holm_is_the_largest_of_the_steps_so_far(p: list[float]) -> None:
    order = sorted(range(len(p)), key=lambda index: p[index])
    for rank, index in enumerate(order):
        steps = [(len(p) - earlier) * p[order[earlier]] for earlier in range(rank + 1)]
        assert adjusted(p, "holm")[index] == pytest.approx(min(1.0, max(steps)), rel=1e-12)


@settings(max_examples=50)
@given(p_values)
def test_benjamini_hochberg_agrees_with_scipy(p: list[float]) -> None:
    assert adjusted(p, "bh") == pytest.approx(false_discovery_control(p, method="bh").tolist(), rel=1e-10, abs=1e-300)


@settings(max_examples=50)
@given(p_values)
def test_holm_asks_for_more_than_benjamini_hochberg_and_that_for_more_than_nothing(p: list[float]) -> None:
    for raw, bh, holm in zip(p, adjusted(p, "bh"), adjusted(p, "holm"), strict=True):
        assert raw <= bh * (1 + 1e-12)
        assert bh <= holm * (1 + 1e-12)
        assert holm <= 1.0


@settings(max_examples=50)
@given(p_values, st.sampled_from(CORRECTIONS))
def test_keeps_the_order_of_p(p: list[float], correction: Correction) -> None:
    found = adjusted(p, correction)
    by_p = [value for _, value in sorted(zip(p, found, strict=True))]
    assert by_p == sorted(found)
    assert all(
        one == two for (p1, one) in zip(p, found, strict=True) for (p2, two) in zip(p, found, strict=True) if p1 == p2
    )


@settings(max_examples=50)
@given(p_values, st.sampled_from(CORRECTIONS), st.integers(0, 99))
def test_does_not_depend_on_the_order_of_rows(p: list[float], correction: Correction, seed: int) -> None:
    order = random.Random(seed).sample(range(len(p)), len(p))
    assert adjusted([p[index] for index in order], correction) == [adjusted(p, correction)[index] for index in order]


@settings(max_examples=50)
@given(p_values)
def test_none_changes_nothing(p: list[float]) -> None:
    assert adjusted(p, "none") == p


@pytest.mark.parametrize("correction", CORRECTIONS)
def test_one_row_needs_no_correction_and_none_gives_none(correction: Correction) -> None:
    assert adjusted([], correction) == []
    assert adjusted([0.03], correction) == [0.03]


def test_by_hand() -> None:
    p = [0.04, 0.001, 0.03, 0.02]
    assert adjusted(p, "holm") == pytest.approx([0.06, 0.004, 0.06, 0.06])
    assert adjusted(p, "bh") == pytest.approx([0.04, 0.004, 0.04, 0.04])
