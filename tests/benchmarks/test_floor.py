"""The floor runs the inventory's products, and nothing else."""

from __future__ import annotations

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode
from weights import counted

from benchmarks.flops import Account, floor, flops
from benchmarks.workloads import SHAPES, WORKLOADS

CPU = torch.device("cpu")


@pytest.mark.parametrize("account", ["released", "needed", "shared"])
@pytest.mark.parametrize("name", WORKLOADS)
def test_products_are_the_inventory(name: str, account: Account) -> None:
    workload = WORKLOADS[name]
    passes = workload.passes(workload.shapes(SHAPES["hopper"]), 300, account)
    run = floor(passes, 2, CPU)
    with FlopCounterMode(display=False) as counter:
        for _ in range(workload.period):
            run()
    assert counter.get_total_flops() == 2 * workload.period * flops(passes)


def test_nothing_but_products() -> None:
    run = floor(WORKLOADS["dilo"].passes(SHAPES["hopper"], 300), 1, CPU)
    assert set(counted(run)) == {"aten.mm"}


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_seeds_are_an_axis_of_batched_products() -> None:
    device = torch.device("cuda")
    passes = WORKLOADS["dilo"].passes(SHAPES["hopper"], 64)
    run = floor(passes, 3, device)
    with FlopCounterMode(display=False) as counter:
        run()
    assert counter.get_total_flops() == 3 * flops(passes)
    assert set(counted(run)) == {"aten.bmm"}
