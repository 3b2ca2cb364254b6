"""The inventories against torch's own count of one engine step: an independent witness of benchmarks/flops.py.

The engine may do less than the formulas' plain reading: one output column needs no product, and losses of one pass
may share signals. It may not do more. Where this fails, the engine changed: see whether the inventory should follow.
"""

from __future__ import annotations

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.flops import Pass, flops
from benchmarks.workloads import SHAPES, WORKLOADS, engine_step, synthetic

CPU = torch.device("cpu")
BATCH = 64
# Two column products of 256 rows in some 72 thousand multiplications a row.
ONE_COLUMN = 0.02


@pytest.mark.parametrize("name", WORKLOADS)
def test_the_engine_multiplies_what_the_formulas_need(name: str) -> None:
    workload = WORKLOADS[name]
    shapes = workload.shapes(SHAPES["hopper"])
    config = workload.method.Config(batch_size=BATCH)  # type: ignore[call-arg]
    view = synthetic(shapes, 500, 99).view(workload.method.needs(config), CPU)
    step = engine_step(workload.method, config, view, [0], CPU, workload.stage)
    with FlopCounterMode(display=False) as counter:
        for _ in range(workload.period):
            step()
    measured = counter.get_total_flops() / workload.period
    extra = 0.0
    if name == "bco":
        # The engine labels every batch where the formulas label the demonstration once.
        extra = flops([Pass("labels", (2 * shapes.observation, 256, 256, shapes.action), BATCH)])
    if name == "oril":
        # Gradients of all inputs of the first critic, where the actions' are enough, every second step.
        extra = BATCH * shapes.observation * 256.0
    assert measured <= flops(workload.passes(shapes, BATCH, "needed")) + extra
    assert measured >= (1.0 - ONE_COLUMN) * flops(workload.passes(shapes, BATCH, "shared"))
