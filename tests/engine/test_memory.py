"""Memory planned from shapes: what counts, and how seeds and jobs are fitted into it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from lfobench.engine.memory import Footprint, fitting_groups, fitting_together, memory_of
from lfobench.engine.probe import peak_bytes

ROW = 4_000
"""Bytes of a thousand float32 numbers."""


def ones() -> Tensor:
    return torch.ones(1_000)


def kept() -> list[Tensor]:
    return [ones(), ones() + 1.0]


def passed_on() -> Tensor:
    value = ones()
    for _ in range(10):
        value = value * 2.0
    return value


def one_after_another() -> None:
    for _ in range(10):
        ones()


def viewed() -> list[Tensor]:
    value = ones()
    return [value, value.view(10, 100), value[::2], value.view(10, 100).t(), value.expand(50, 1_000), value.detach()]


def materialized() -> Tensor:
    return ones().expand(50, 1_000).contiguous()


def in_place() -> Tensor:
    value = ones()
    value.add_(1.0).mul_(2.0).clamp_(0.0, 3.0)
    value[:500] = 7.0
    return value


def joined() -> Tensor:
    return torch.cat([ones(), ones()])


def split() -> list[Tensor]:
    return list(torch.split(torch.ones(3_000), 1_000))


def doubles() -> Tensor:
    return torch.zeros(1_000, dtype=torch.float64)


@pytest.mark.parametrize(
    ("work", "expected"),
    [
        (lambda: None, 0),
        (ones, ROW),
        # ones, ones, and the sum that is made while its argument is there
        (kept, 3 * ROW),
        (passed_on, 2 * ROW),
        (one_after_another, ROW),
        (viewed, ROW),
        (materialized, 51 * ROW),
        (in_place, ROW),
        (joined, 4 * ROW),
        (split, 3 * ROW),
        (doubles, 2 * ROW),
    ],
)
def test_tensors_alive_at_once(work: Callable[[], object], expected: int) -> None:
    assert peak_bytes(work) == expected


def test_what_was_there_before_does_not_count() -> None:
    given, other = torch.ones(1_000_000), torch.ones(1_000_000)
    assert peak_bytes(lambda: given.add_(other).mul_(2.0)) == 0
    assert peak_bytes(lambda: given.view(1_000, 1_000)[3].mul_(2.0)) == 0
    assert peak_bytes(lambda: torch.add(given, 1.0, out=other)) == 0
    assert peak_bytes(lambda: given.sum()) == 4


def test_what_takes_the_place_of_something_given_counts() -> None:
    """The allocator hands the address of a freed storage to the next one."""

    def work() -> list[Tensor]:
        made = []
        for _ in range(20):
            given = torch.tensor([1.0])
            given.add_(1.0)
            del given
            made.append(ones())
        return made

    assert peak_bytes(work) == 20 * ROW


def test_a_backward_pass_counts_what_it_keeps_and_makes() -> None:
    """exp keeps its result for the gradient of its argument; a result that someone else holds stays longer.

    Two rows and two scalars (the sum and its gradient): the result and its gradient, then the two gradients. With the
    result held on to, all three.
    """
    leaf = torch.ones(1_000, requires_grad=True)

    def let_go() -> None:
        (leaf * 2.0).exp().sum().backward()

    def held_on() -> None:
        result = (leaf * 2.0).exp()
        result.sum().backward()

    assert peak_bytes(let_go) == 2 * ROW + 8
    leaf.grad = None
    assert peak_bytes(held_on) == 3 * ROW + 8


def test_measuring_ends_with_the_work_also_when_it_fails() -> None:
    def fails() -> None:
        ones()
        raise KeyError("no such thing")

    with pytest.raises(KeyError):
        peak_bytes(fails)
    assert peak_bytes(ones) == ROW


def test_memory_of_this_machine() -> None:
    found = memory_of(torch.device("cpu"))
    if found.free is not None:
        assert found.capacity is not None
        assert 2**20 < found.free < found.capacity < 2**50


def test_a_footprint_grows_with_its_seeds_and_keeps_a_margin() -> None:
    footprint = Footprint(fixed=100, per_seed=30)
    totals = [footprint.total(seeds) for seeds in range(5)]
    assert totals == sorted(set(totals))
    assert all(total >= 100 + 30 * seeds for seeds, total in enumerate(totals))


SEEDS = st.lists(st.integers(0, 99), min_size=1, max_size=12, unique=True)
FOOTPRINTS = st.builds(Footprint, fixed=st.integers(0, 1_000), per_seed=st.integers(0, 1_000))
AVAILABLE = st.one_of(st.none(), st.integers(0, 20_000))


@given(SEEDS, FOOTPRINTS, st.one_of(st.none(), st.integers(0, 13)), st.integers(-1, 1))
def test_seeds_in_groups(seeds: list[int], footprint: Footprint, seats: int | None, more: int) -> None:
    """In memory for a number of seeds, exactly or all but."""
    available = None if seats is None else max(0, footprint.total(seats) + more)
    groups = fitting_groups(seeds, footprint, available)
    assert [seed for group in groups for seed in group] == seeds, "every seed once, in order"
    sizes = [len(group) for group in groups]
    assert max(sizes) - min(sizes) <= 1

    def fits(size: int) -> bool:
        return available is None or footprint.total(size) <= available

    assert all(fits(size) or size == 1 for size in sizes)
    if len(groups) > 1:
        fewer = -(-len(seeds) // (len(groups) - 1))
        assert not fits(fewer), "one group fewer would hold a group that does not fit"


def test_seeds_of_seven_in_groups() -> None:
    footprint = Footprint(fixed=0, per_seed=100)
    assert fitting_groups(range(7), footprint, 7 * 150) == [(0, 1, 2, 3, 4, 5, 6)]
    assert [len(group) for group in fitting_groups(range(7), footprint, 5 * 150)] == [3, 4]
    assert [len(group) for group in fitting_groups(range(7), footprint, 0)] == [1] * 7


TOTALS = st.lists(st.integers(0, 1_000), min_size=1, max_size=7)


@given(TOTALS, AVAILABLE, st.integers(1, 9))
def test_jobs_at_once(totals: list[int], available: int | None, most: int) -> None:
    count = fitting_together(totals, available, most)
    limit = min(most, len(totals))
    assert 1 <= count <= limit
    if available is None:
        assert count == limit
        return

    def any_fit(jobs: int) -> bool:
        return all(sum(chosen) <= available for chosen in combinations(totals, jobs))

    assert count == 1 or any_fit(count), "whichever of them run beside each other"
    assert count == limit or not any_fit(count + 1), "no more would"


@given(TOTALS, st.integers(0, 8_000), st.integers(0, 8_000), st.integers(1, 9))
def test_more_memory_never_means_fewer_jobs(totals: list[int], one: int, other: int, most: int) -> None:
    less, more = sorted((one, other))
    assert fitting_together(totals, less, most) <= fitting_together(totals, more, most)
