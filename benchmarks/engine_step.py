"""The engine's training step as something to time: the only module here that knows how the engine makes one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from lfobench.cells.cell import Precision
from lfobench.contract.method import Method, MethodConfig
from lfobench.data.firewall import View
from lfobench.engine.program import Program, recorder_for
from lfobench.randomness import Randomness


def engine_step(
    method_class: type[Method],
    config: MethodConfig,
    view: View,
    seeds: Sequence[int],
    device: torch.device,
    stage: str | None = None,
    precision: Precision = "auto",
) -> Callable[[], None]:
    """A call that samples and updates once, for every seed.

    Args:
        method_class: what trains.
        config: its hyperparameters.
        view: the data, on `device`.
        seeds: the seed axis.
        device: where it trains.
        stage: name of a stage; None for the last one.
        precision: of matrix products.
    """
    method = method_class(config, view.shapes, seeds, device)
    stages = method.stages(view.sizes)
    running = stages[-1] if stage is None else next(found for found in stages if found.name == stage)
    randomness = Randomness(seeds, device)
    program = Program(method, view, running, randomness, precision=precision, recorder=recorder_for(device))
    step = 0

    def run() -> None:
        nonlocal step
        program.update(step)
        step += 1

    return run
