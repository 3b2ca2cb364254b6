"""Measurements of `make bench`, section by section."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch

from benchmarks import built_task, views
from benchmarks.evaluation import compare_evaluation, control_steps
from benchmarks.hardware import describe
from benchmarks.pairs import TARGETS, Contender, Finding, Spread
from benchmarks.training import AUTHORS, ENGINE, SEEDS, Bench, Effort, StepComparison, compare_ablations
from benchmarks.workloads import SHAPES, WORKLOADS
from lfobench.cells.cell import effective
from lfobench.engine.program import has_bf16_units
from lfobench.processes import keep_freed_memory

NO_GPU = "no CUDA device here"
NO_BF16 = "no bf16 units here"
SKIPPED = "not asked for"
Section = Callable[["Speed"], Iterator[tuple[str, Finding]]]


@dataclass
class Speed:
    """One run of the benchmarks.

    Attributes:
        device: where training is measured.
        quick: a run that only shows that everything works.
        raw: what every section measured, as JSON data.
    """

    device: torch.device
    quick: bool
    raw: dict[str, Any] = field(default_factory=dict)

    @property
    def effort(self) -> Effort:
        """Effort of measuring training steps."""
        return Effort.of(self.quick)

    @property
    def rounds(self) -> int:
        """Repetitions of measurements that take seconds."""
        return 1 if self.quick else 5

    @property
    def cores(self) -> int:
        """Effort of measuring on the processor."""
        return describe(self.device).cores

    @property
    def bench(self) -> Bench:
        """Training steps on hopper's shapes; the floor has no product that the losses of one pass could share."""
        return Bench(self.device, self.effort, account="shared")

    def steps(self) -> Iterator[tuple[str, Finding]]:
        """Every method's step against the authors' loop and the floor."""
        found = self.bench.steps(batches=(256, 1024))
        self.raw["steps"] = [each.as_json() for each in found]
        if self.device.type == "cpu":
            dilo = {each.batch: each for each in found if each.workload == "dilo"}
            yield "cpu floor", Finding(TARGETS["cpu floor"], dilo[1024].above_floor)
            yield "cpu authors", Finding(TARGETS["cpu authors"], dilo[256].speedup)

    def seeds(self) -> Iterator[tuple[str, Finding]]:
        """Several seeds in one program."""
        numbers = (1, 2) if self.quick else SEEDS
        batch = WORKLOADS["dilo"].released_batch if self.device.type == "cuda" else 256
        together = self.bench.seeds(WORKLOADS["dilo"], batch, numbers)
        self.raw["seeds"] = together.as_json()
        if self.device.type == "cuda" and not self.quick:
            yield "gpu seeds", Finding(TARGETS["gpu seeds"], together.step_ratio(7))
            yield "gpu seed-steps", Finding(TARGETS["gpu seed-steps"], self._seed_steps(7))

    def ablations(self) -> Iterator[tuple[str, Finding]]:
        """The engine without one of its parts, against the engine as it is."""
        self.raw["ablations"] = [each.as_json() for each in compare_ablations(self.bench)]
        yield from ()

    def bf16(self) -> Iterator[tuple[str, Finding]]:
        """The engine with bf16 products against the authors' loop."""
        if self.device.type != "cpu":
            return
        if not has_bf16_units():
            yield "cpu bf16", Finding(TARGETS["cpu bf16"], None, NO_BF16)
            return
        workload = WORKLOADS["dilo"]
        data = workload.data(SHAPES["hopper"], self.effort.offline_rows, self.effort.expert_rows)
        timing = self.effort.time(
            [
                Contender(AUTHORS, workload.authors_step(data, 1024, self.device)),
                Contender(ENGINE, workload.engine_step(data, 1024, 1, self.device, "bf16")),
            ],
            self.device,
        )
        self.raw["bf16"] = StepComparison("dilo", "hopper", 1024, 0.0, timing).timing.as_json()
        yield "cpu bf16", Finding(TARGETS["cpu bf16"], timing.ratio(AUTHORS, ENGINE))

    def evaluation(self) -> Iterator[tuple[str, Finding]]:
        """One environment at a time, lock step, and all cores."""
        horizon = 20 if self.quick else 300
        found = [compare_evaluation(name, rounds=self.rounds, horizon=horizon) for name in ("halfcheetah", "hopper")]
        self.raw["evaluation"] = [each.as_json() for each in found]
        worst = min((each.workers_speedup for each in found), key=lambda spread: spread.median)
        yield "evaluation", Finding(TARGETS["evaluation"], _scaled(worst, 1.0 / self.cores))

    def simulation(self) -> Iterator[tuple[str, Finding]]:
        """The robot simulation, all worlds in lock step on one core."""
        found = control_steps(self.quick, self.rounds)
        self.raw["simulation"] = {name: spread.as_json() for name, spread in found.items()}
        yield "simulation", Finding(TARGETS["simulation"], min(found.values(), key=lambda spread: spread.median))

    def loading(self) -> Iterator[tuple[str, Finding]]:
        """From files on disk to tables."""
        found = built_task.loading(self.quick, self.rounds)
        self.raw["loading"] = found
        yield "loading", Finding(TARGETS["loading"], built_task.spread_of(found["dilo"]["seconds"]))

    def cell(self) -> Iterator[tuple[str, Finding]]:
        """One cell from data on disk to records."""
        on_cuda = self.device.type == "cuda"
        found = built_task.whole_cell(self.device, 7 if on_cuda else 1, self.cores if on_cuda else 0, self.quick)
        self.raw["cell"] = found
        if on_cuda:
            wall = found["wall_seconds"]
            yield "gpu cell", Finding(TARGETS["gpu cell"], Spread(wall, wall, wall))

    def statistics(self) -> Iterator[tuple[str, Finding]]:
        """Intervals by bootstrap, on one thread."""
        found = views.bootstrap_seconds(self.quick, self.rounds)
        self.raw["statistics"] = found.as_json()
        yield "bootstrap", Finding(TARGETS["bootstrap"], found)

    def records(self) -> Iterator[tuple[str, Finding]]:
        """From a folder of records to a frame."""
        found = views.record_seconds(self.quick, self.rounds)
        self.raw["records"] = found
        yield "records", Finding(TARGETS["records"], built_task.spread_of(found["again"]))

    def _seed_steps(self, seeds: int) -> Spread:
        workload = WORKLOADS["dilo"]
        data = workload.data(SHAPES["hopper"], self.effort.offline_rows, self.effort.expert_rows)
        batch = workload.released_batch
        timing = self.effort.time(
            [
                Contender(AUTHORS, workload.authors_step(data, batch, self.device)),
                Contender(ENGINE, workload.engine_step(data, batch, seeds, self.device)),
            ],
            self.device,
        )
        self.raw["seed_steps"] = timing.as_json()
        return _scaled(timing.ratio(AUTHORS, ENGINE), seeds)


SECTIONS: dict[str, Section] = {
    "loading": Speed.loading,
    "cell": Speed.cell,
    "steps": Speed.steps,
    "ablations": Speed.ablations,
    "bf16": Speed.bf16,
    "seeds": Speed.seeds,
    "evaluation": Speed.evaluation,
    "simulation": Speed.simulation,
    "statistics": Speed.statistics,
    "records": Speed.records,
}


def measure(
    device: str, quick: bool, sections: Sequence[str], report: Callable[[str], None]
) -> tuple[list[Finding], dict[str, Any]]:
    """Run sections of the benchmarks.

    Args:
        device: ``cpu`` or ``cuda``.
        quick: only show that everything runs; the figures mean nothing.
        sections: names of `SECTIONS`.
        report: gets the name of every section as it begins.

    Returns:
        A finding per target, in their order, and the raw values as JSON data.
    """
    torch.set_num_threads(1)
    keep_freed_memory()  # as a job does; it serves every contender of this process
    # For every contender alike; the engine would switch it on for itself.
    torch.backends.cuda.matmul.allow_tf32 = effective("auto", device) == "tf32"
    speed = Speed(torch.device(device), quick)
    hardware = describe(speed.device)
    found: dict[str, Finding] = {}
    for name in sections:
        report(name)
        found |= dict(SECTIONS[name](speed))
    findings = [
        found.get(key) or Finding(target, None, NO_GPU if key.startswith("gpu") and device == "cpu" else SKIPPED)
        for key, target in TARGETS.items()
    ]
    raw = {
        "hardware": hardware.as_json(),
        "quick": quick,
        "targets": [finding.as_json() for finding in findings],
        **speed.raw,
    }
    return findings, raw


def _scaled(spread: Spread, by: float) -> Spread:
    return Spread(spread.minimum * by, spread.median * by, spread.maximum * by)
