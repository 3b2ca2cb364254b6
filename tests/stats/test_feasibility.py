from __future__ import annotations

import pytest

from lfobench.stats.comparison import PAIRED, p_value
from lfobench.stats.feasibility import can_reach, smallest_p
from lfobench.stats.names import Test
from lfobench.stats.sample import sample_of


@pytest.mark.parametrize(("n", "expected"), [(3, 0.1), (5, 0.0079), (7, 0.00058), (10, 1.1e-5)])
def test_the_smallest_rank_p_of_few_seeds(n: int, expected: float) -> None:
    assert smallest_p("mann-whitney", n, n) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("test", ["mann-whitney", "permutation"])
@pytest.mark.parametrize(("n", "m"), [(2, 2), (3, 2), (3, 3), (5, 4), (7, 7)])
def test_no_data_give_less(test: Test, n: int, m: int) -> None:
    """Two groups far apart are as extreme as a relabelling can be."""
    for first, second in (
        ([10.0 + i for i in range(n)], [float(i) for i in range(m)]),
        ([1.0] * n, [0.0] * m),
    ):
        found, least = p_value(test, sample_of(first), sample_of(second)), smallest_p(test, n, m)
        assert found is not None and least is not None
        assert found >= least - 1e-12
        if n == m:
            assert found == pytest.approx(least)


@pytest.mark.parametrize("test", ["wilcoxon", "paired-permutation"])
def test_the_smallest_p_of_pairs_is_reached(test: Test) -> None:
    one, two = sample_of([0.0], [11.0, 12.5, 13.0, 14.0, 17.0]), sample_of([0.0], [0.0] * 5)
    assert test in PAIRED
    assert p_value(test, one, two) == smallest_p(test, 5, 5) == 2 / 32


def test_t_tests_have_no_floor_and_one_seed_has_no_test() -> None:
    assert smallest_p("welch", 2, 2) == 0.0
    assert smallest_p("welch", 1, 9) is None
    assert not can_reach("welch", 1, 9, 0.05, 1, "none")


def test_what_few_seeds_can_reach() -> None:
    """With 5 seeds an exact test never survives Holm over 24 rows; with 7 it can."""
    assert not can_reach("permutation", 3, 3, 0.05, 1, "none")
    assert can_reach("permutation", 5, 5, 0.05, 24, "none")
    assert not can_reach("permutation", 5, 5, 0.05, 24, "holm")
    assert can_reach("permutation", 7, 7, 0.05, 24, "holm")
    assert can_reach("permutation", 5, 5, 0.05, 24, "bh")
