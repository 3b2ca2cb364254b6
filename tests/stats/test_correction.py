from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import false_discovery_control

from lfobench.stats.correction import adjusted

p_values = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12)


def rejected_by_holm(p: list[float], alpha: float) -> set[int]:
    """Holm's steps as he wrote them: reject while the smallest left is below alpha over how many are left."""
    left = sorted(range(len(p)), key=lambda index: p[index])
    rejected = set()
    while left and p[left[0]] * len(left) < alpha:
        rejected.add(left.pop(0))
    return rejected


def rejected_by_hochberg(p: list[float], alpha: float) -> set[int]:
    """The largest k whose k-th smallest p is below k alpha / m; reject the k smallest."""
    order = sorted(range(len(p)), key=lambda index: p[index])
    largest = max((k for k in range(1, len(p) + 1) if p[order[k - 1]] * len(p) / k < alpha), default=0)
    return set(order[:largest])


@given(p_values, st.sampled_from([0.01, 0.05, 0.3]))
def test_rejections_are_those_of_the_procedures(p: list[float], alpha: float) -> None:
    assert {i for i, value in enumerate(adjusted(p, "holm")) if value < alpha} == rejected_by_holm(p, alpha)
    assert {i for i, value in enumerate(adjusted(p, "bh")) if value < alpha} == rejected_by_hochberg(p, alpha)


@given(p_values)
def test_benjamini_hochberg_agrees_with_scipy(p: list[float]) -> None:
    assert adjusted(p, "bh") == pytest.approx(false_discovery_control(p).tolist(), abs=1e-12)


@given(p_values)
def test_holm_is_stricter_than_hochberg_which_is_stricter_than_nothing(p: list[float]) -> None:
    assert adjusted(p, "none") == p
    for raw, hochberg, holm in zip(p, adjusted(p, "bh"), adjusted(p, "holm"), strict=True):
        assert raw <= hochberg + 1e-15
        assert hochberg <= holm + 1e-15
        assert holm <= 1.0


@given(p_values, st.randoms(use_true_random=False), st.sampled_from(["holm", "bh"]))
def test_order_does_not_matter(p: list[float], random: object, correction: str) -> None:
    order = list(range(len(p)))
    random.shuffle(order)  # type: ignore[attr-defined]
    whole = adjusted(p, correction)  # type: ignore[arg-type]
    assert adjusted([p[i] for i in order], correction) == [whole[i] for i in order]  # type: ignore[arg-type]


def test_a_worked_example() -> None:
    assert adjusted([0.01, 0.04, 0.03, 0.005], "holm") == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert adjusted([0.01, 0.04, 0.03, 0.005], "bh") == pytest.approx([0.02, 0.04, 0.04, 0.02])


def test_nothing_tested_is_nothing_adjusted() -> None:
    for correction in ("none", "holm", "bh"):
        assert adjusted([], correction) == []  # type: ignore[arg-type]
