"""Threads of a process share the products of a step and change none of its numbers, at the size of a real run."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch
from method_helpers import CPU, random_view
from torch import Tensor

from lfobench.contract.method import Shapes
from lfobench.engine.program import Program
from lfobench.engine.state import live_tensors
from lfobench.randomness import Randomness
from lfobench.registry import load_method
from lfobench.schedule.jobs import MOST_THREADS

STEPS = 3
HOPPER = Shapes(11, 3)

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def one_thread_afterwards() -> Iterator[None]:
    yield
    torch.set_num_threads(1)


def trained(name: str, threads: int) -> dict[str, Tensor]:
    """State and sums of metrics of every stage of one seed with the released batch and widths."""
    torch.set_num_threads(threads)
    kind = load_method(name)
    config = kind.Config()
    view = random_view(kind.needs(config), HOPPER, 5_000, 3_000)
    method = kind(config, HOPPER, [0], CPU)
    found = {}
    for stage in method.stages(view.sizes):
        program = Program(method, view, stage, Randomness([0]))
        for step in range(STEPS):
            program.update(step)
        found |= {f"{stage.name} {metric}": total for metric, total in program.metric_sums().items()}
    return {**live_tensors(method), **found}


@pytest.mark.parametrize("name", ["dilo", "smodice", "oril", "bco", "bc"])
def test_threads_compute_what_one_does(name: str) -> None:
    """Bit for bit: threads share out rows and columns of products and elements of sums, not the terms of a sum."""
    one = trained(name, 1)
    for threads in (2, MOST_THREADS):
        several = trained(name, threads)
        assert one.keys() == several.keys()
        for entry in one:
            assert torch.equal(one[entry], several[entry]), (entry, threads)
