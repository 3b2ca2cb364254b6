"""Ablations of the engine: a training step without one of its parts, over the step as it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

from torch import Tensor

from benchmarks.pairs import Alternation, Contender, Spread
from benchmarks.training import Bench
from benchmarks.workloads import SHAPES, WORKLOADS
from lfobench.engine import batches as sampling
from lfobench.nn import networks
from lfobench.nn.perceptron import Parameters, composed

AS_IT_IS = "as it is"
CASES = (("dilo", 256), ("dilo", 1024), ("smodice", 512), ("bc", 512))


@dataclass(frozen=True)
class Ablation:
    """One workload with and without a part.

    Attributes:
        workload: its name.
        batch: rows per part.
        without: the part, as ``without ...``.
        timing: per call, one step.
    """

    workload: str
    batch: int
    without: str
    timing: Alternation

    @property
    def ratio(self) -> Spread:
        """A step without over a step with."""
        return self.timing.ratio(self.without, AS_IT_IS)

    def as_json(self) -> dict[str, Any]:
        """JSON data."""
        return {
            "workload": self.workload,
            "batch_size": self.batch,
            "without": self.without,
            "without_over_with": self.ratio.as_json(),
            "timings": self.timing.as_json(),
        }


@contextmanager
def _without_hand_written_passes() -> Iterator[None]:
    """Every pass by torch's own operations and its autograd."""

    def autograd(parameters: Parameters, inputs: Tensor) -> Tensor:
        return composed(parameters.layout, parameters.leaf, inputs)

    def plain(parameters: Parameters, inputs: Tensor) -> Tensor:
        return composed(parameters.layout, parameters.flat, inputs)

    with patch.object(networks, "differentiable", autograd), patch.object(networks, "evaluated", plain):
        yield


@contextmanager
def _without_draws_in_chunks() -> Iterator[None]:
    """Random numbers drawn step by step."""
    with patch.object(sampling, "CHUNK", 1):
        yield


ABLATIONS: dict[str, Callable[[], Any]] = {
    "without hand-written passes": _without_hand_written_passes,
    "without draws in chunks": _without_draws_in_chunks,
}


def compare_ablations(bench: Bench) -> list[Ablation]:
    """Every case without every part, in alternation with the engine as it is."""
    found = []
    for name, batch in CASES:
        workload = WORKLOADS[name]
        data = workload.data(SHAPES[bench.task], bench.effort.offline_rows, bench.effort.expert_rows)
        for without, change in ABLATIONS.items():
            whole = workload.engine_step(data, batch, 1, bench.device)
            with change():
                reduced = workload.engine_step(data, batch, 1, bench.device)

            def step(reduced: Callable[[], None] = reduced, change: Callable[[], Any] = change) -> None:
                with change():
                    reduced()

            timing = bench.effort.time([Contender(without, step), Contender(AS_IT_IS, whole)], bench.device)
            found.append(Ablation(name, batch, without, timing))
    return found
