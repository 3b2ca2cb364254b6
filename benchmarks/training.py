"""Training steps: authors' loops, floor of matrix products, many seeds, ablations of the engine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import torch
from torch import Tensor

from benchmarks.flops import Account, floor, flops
from benchmarks.pairs import Alternation, Contender, Spread, alternate
from benchmarks.workloads import EXPERT_ROWS, OFFLINE_ROWS, SHAPES, WORKLOADS, Synthetic, Workload
from lfobench.engine import batches as sampling
from lfobench.nn import networks
from lfobench.nn.perceptron import Parameters, composed

AUTHORS, ENGINE, FLOOR = "authors", "engine", "floor"
SEEDS = (1, 2, 4, 7, 14, 28)


@dataclass(frozen=True)
class Effort:
    """Effort of a measurement: rounds and amount of data.

    Attributes:
        rounds: blocks per contender.
        block_seconds: length of a block.
        warm_up: periods before the first block.
        offline_rows: of the random data.
        expert_rows: of the random data.
    """

    rounds: int = 12
    block_seconds: float = 0.5
    warm_up: int = 5
    offline_rows: int = OFFLINE_ROWS
    expert_rows: int = EXPERT_ROWS

    @classmethod
    def of(cls, quick: bool) -> Effort:
        """The full effort, or one that only shows that everything runs."""
        return cls(rounds=2, block_seconds=0.0, warm_up=1, offline_rows=2000, expert_rows=100) if quick else cls()

    def time(self, contenders: Sequence[Contender], device: torch.device) -> Alternation:
        """The contenders in alternation."""
        return alternate(
            contenders,
            rounds=self.rounds,
            block_seconds=self.block_seconds,
            warm_up=self.warm_up,
            device=device,
        )


@dataclass(frozen=True)
class StepComparison:
    """Authors' loop, engine and floor of one workload with one seed, timed together.

    Attributes:
        workload: its name.
        task: whose shapes the data has.
        batch: rows per part.
        gigaflops: of the matrix products that the formulas need, 10^9 operations per step.
        timing: per call, one step.
    """

    workload: str
    task: str
    batch: int
    gigaflops: float
    timing: Alternation

    @property
    def speedup(self) -> Spread:
        """A step of the authors' loop over one of the engine's."""
        return self.timing.ratio(AUTHORS, ENGINE)

    @property
    def above_floor(self) -> Spread:
        """A step of the engine over its matrix products alone."""
        return self.timing.ratio(ENGINE, FLOOR)

    def as_json(self) -> dict[str, Any]:
        """JSON data."""
        return {
            "workload": self.workload,
            "task": self.task,
            "batch_size": self.batch,
            "gigaflop_per_step": round(self.gigaflops, 3),
            "authors_over_engine": self.speedup.as_json(),
            "engine_over_floor": self.above_floor.as_json(),
            "timings": self.timing.as_json(),
        }


@dataclass(frozen=True)
class SeedsTogether:
    """The engine with several numbers of seeds, timed together.

    Attributes:
        workload: its name.
        task: whose shapes the data has.
        batch: rows per part and seed.
        seeds: the numbers of seeds; the first is what the others are relative to.
        timing: per call, one step of all seeds; named by the number of seeds.
    """

    workload: str
    task: str
    batch: int
    seeds: tuple[int, ...]
    timing: Alternation

    def step_ratio(self, seeds: int) -> Spread:
        """A step of that many seeds over a step of the first number of seeds."""
        return self.timing.ratio(str(seeds), str(self.seeds[0]))

    def seed_step_ratio(self, seeds: int) -> Spread:
        """The same per seed: below 1 where seeds together are cheaper than one after the other."""
        steps, scale = self.step_ratio(seeds), self.seeds[0] / seeds
        return Spread(steps.minimum * scale, steps.median * scale, steps.maximum * scale)

    def as_json(self) -> dict[str, Any]:
        """JSON data."""
        return {
            "workload": self.workload,
            "task": self.task,
            "batch_size": self.batch,
            "relative_to": self.seeds[0],
            "seeds": [
                {
                    "seeds": seeds,
                    "seconds_per_step": self.timing.timings[str(seeds)].spread.as_json(),
                    "seconds_per_seed_step": self._per_seed(seeds).as_json(),
                    "step_ratio": self.step_ratio(seeds).as_json(),
                    "seed_step_ratio": self.seed_step_ratio(seeds).as_json(),
                }
                for seeds in self.seeds
            ],
            "timings": self.timing.as_json(),
        }

    def _per_seed(self, seeds: int) -> Spread:
        return Spread.of([seconds / seeds for seconds in self.timing.timings[str(seeds)].seconds])


@dataclass(frozen=True)
class Bench:
    """Device, effort and data of a measurement of training steps.

    Attributes:
        device: where the steps run.
        effort: rounds and amount of data.
        task: whose shapes the data has.
        account: inventory of the floor.
    """

    device: torch.device
    effort: Effort = field(default_factory=Effort)
    task: str = "hopper"
    account: Account = "needed"

    def step(self, workload: Workload, batch: int) -> StepComparison:
        """Authors' loop, engine and floor in alternation, in this process.

        Args:
            workload: what is timed.
            batch: rows per part.
        """
        data = self._data(workload)
        passes = workload.passes(data.shapes, batch, self.account)
        contenders = (
            Contender(AUTHORS, workload.authors_step(data, batch, self.device), workload.period),
            Contender(ENGINE, workload.engine_step(data, batch, 1, self.device), workload.period),
            Contender(FLOOR, floor(passes, 1, self.device), workload.period),
        )
        timing = self.effort.time(contenders, self.device)
        return StepComparison(workload.name, self.task, batch, flops(passes) / 1e9, timing)

    def seeds(self, workload: Workload, batch: int, seeds: Sequence[int] = SEEDS) -> SeedsTogether:
        """The engine with one seed and with several in one program, in alternation.

        Args:
            workload: what is timed.
            batch: rows per part and seed.
            seeds: numbers of seeds.
        """
        data = self._data(workload)
        contenders = [
            Contender(str(count), workload.engine_step(data, batch, count, self.device), workload.period)
            for count in seeds
        ]
        timing = self.effort.time(contenders, self.device)
        return SeedsTogether(workload.name, self.task, batch, tuple(seeds), timing)

    def steps(self, batches: Sequence[int] = (256, 1024)) -> list[StepComparison]:
        """Every method at its released batch, and DILO at `batches` too."""
        pairs = dict.fromkeys((name, workload.released_batch) for name, workload in WORKLOADS.items())
        pairs |= dict.fromkeys(("dilo", batch) for batch in batches)
        return [self.step(WORKLOADS[name], batch) for name, batch in sorted(pairs)]

    def _data(self, workload: Workload) -> Synthetic:
        return workload.data(SHAPES[self.task], self.effort.offline_rows, self.effort.expert_rows)


AS_IT_IS = "as it is"
ABLATED = (("dilo", 256), ("dilo", 1024), ("smodice", 512), ("bc", 512))


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
    for name, batch in ABLATED:
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
