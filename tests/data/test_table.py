"""Tables serve rows by tensor operations alone: the same values as plain indexing, on any device, in any graph."""

from __future__ import annotations

import pytest
import torch
from raw_rows import make_episodes
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.fx.experimental.proxy_tensor import make_fx

from lfobench.contract.method import DataNeeds, Field
from lfobench.contract.suite import Recipe
from lfobench.data.firewall import Column, Table, view
from lfobench.data.mixing import mix
from lfobench.randomness import Randomness
from lfobench.registry import load_method

ROWS, STORED = 30, 50


def columns(index_type: torch.dtype) -> dict[Field, Column]:
    generator = torch.Generator().manual_seed(0)
    storage = torch.rand(STORED, 4, generator=generator)
    here = torch.randint(0, STORED - 1, (ROWS,), generator=generator)
    return {
        "observation": (storage, here.to(index_type)),
        "next_observation": (storage, (here + 1).to(index_type)),
        "action": (torch.rand(ROWS, 2, generator=generator), None),
        "terminated": (torch.rand(ROWS, generator=generator).round(), None),
    }


def plainly(served: dict[Field, Column], row: Tensor) -> dict[Field, Tensor]:
    return {
        field: storage[row] if index is None else storage[index.long()[row]]
        for field, (storage, index) in served.items()
    }


def drawn(seeds: int, batch: int, seed: int = 3) -> Tensor:
    return torch.randint(0, ROWS, (seeds, batch), generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("index_type", [torch.int32, torch.int64])
@pytest.mark.parametrize(("seeds", "batch"), [(1, 1), (1, 7), (3, 64), (2, 0)])
def test_a_batch_is_what_indexing_gives(index_type: torch.dtype, seeds: int, batch: int) -> None:
    served = columns(index_type)
    row = drawn(seeds, batch)
    found = Table(served, ROWS, ROWS).batch(row)
    expected = plainly(served, row)
    assert list(found) == list(served)
    for field, values in found.items():
        assert values.shape[:2] == (seeds, batch)
        assert values.is_contiguous()
        assert torch.equal(values, expected[field])


def test_rows_may_be_a_slice_of_more() -> None:
    served = columns(torch.int32)
    pass_over_the_table = drawn(2, 64)
    row = pass_over_the_table[:, 5:9]
    found, expected = Table(served, ROWS, ROWS).batch(row), plainly(served, row)
    assert all(torch.equal(found[field], expected[field]) for field in served)


def test_a_recorded_batch_serves_other_rows() -> None:
    """What a captured graph needs: nothing read back, nothing decided by a value."""
    table = Table(columns(torch.int32), ROWS, ROWS)
    recorded = make_fx(lambda row: dict(table.batch(row)))(drawn(2, 8))
    row = drawn(2, 8, seed=4)
    found, expected = recorded(row), table.batch(row)
    assert all(torch.equal(found[field], expected[field]) for field in expected)


def test_tensors_without_values_are_served() -> None:
    with FakeTensorMode():
        fake = columns(torch.int32)
        batch = Table(fake, ROWS, ROWS).batch(torch.zeros(2, 8, dtype=torch.int64))
    assert {field: tuple(values.shape) for field, values in batch.items()} == {
        "observation": (2, 8, 4),
        "next_observation": (2, 8, 4),
        "action": (2, 8, 2),
        "terminated": (2, 8),
    }


def test_indices_take_half_the_memory_where_they_can() -> None:
    offline, expert = make_episodes([(9, False)] * 4), make_episodes([(9, False)] * 4, start=500)
    needs = DataNeeds(offline=("observation", "initial_observation"), expert=("observation",))
    mixture = mix(offline, expert, Recipe("random", 36, "expert", 2, 9), needs, 9)
    sight = view(load_method("dilo"), needs, mixture, torch.device("cpu"))
    for table in (sight.offline, sight.initial, sight.expert):
        for _, index in table._columns.values():
            assert index is not None
            assert index.dtype == torch.int32


@pytest.mark.parametrize("seeds", [[3], [0, 1, 2]])
@pytest.mark.parametrize("count", [0, 1, 2, 5, 4_001])
def test_an_order_is_that_of_the_words(seeds: list[int], count: int) -> None:
    """However it is sorted: the rows of every record so far lie in this order."""
    randomness = Randomness(seeds)
    words = randomness.words("order of the rows", 0, count)
    expected = torch.argsort(words, dim=-1, stable=True)
    assert torch.equal(randomness.permutation("order of the rows", 0, count), expected)
