"""Cells and jobs for the tests of everything below the command line, and fake methods that behave as told."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import torch
from pydantic import Field as ConfigField
from torch import Tensor

from lfobench.cells.cell import PROTOCOLS, Cell, Protocol
from lfobench.cells.parts import requests
from lfobench.cells.plan import Request, make_plan
from lfobench.contract.method import (
    Batch,
    DataNeeds,
    Method,
    MethodConfig,
    Metrics,
    Shapes,
    Sizes,
    Stage,
)
from lfobench.data.build import build, missing_shards
from lfobench.engine.batches import StageSampler
from lfobench.engine.job import Advance, Job, Recorded, TrainedElsewhere, run_job
from lfobench.files import locked
from lfobench.randomness import StepRandomness
from lfobench.record import Record
from lfobench.records.folder import RecordFolder, read_record
from lfobench.registry import load_suite

TINY = str(Path(__file__).with_name("tiny_suite.py"))
POLE_TASK = "pole-random-expert"
HOPPER_TASK = "hopper-random-expert"
SMOKE = PROTOCOLS["smoke"]


def never() -> bool:
    """A stop that is never asked for."""
    return False


class StopAfter:
    """A stop that is asked for at the n-th question."""

    def __init__(self, questions: int) -> None:
        self.left = questions

    def __call__(self) -> bool:
        self.left -= 1
        return self.left < 0


def smoke_cell(method: str, task: str = POLE_TASK, suite: str = TINY, **request: Any) -> Cell:
    """The cell of a registered method, as the command line makes it."""
    (cell,) = make_plan(Request(method, suite, task, protocol="smoke", **request), never).cells
    return cell


def cell_of(method: type[Method], protocol: Protocol = SMOKE, **fields: Any) -> Cell:
    """The cell of a method class on the pole."""
    cell = smoke_cell("bc")
    return replace(cell, method=method, config=method.Config(**fields), budget={}, assigned={}, protocol=protocol)


def provide_data(cell: Cell, cache: Path) -> None:
    """Build what the cell reads, once, also when several processes ask."""
    cache.mkdir(parents=True, exist_ok=True)
    with locked(cache / "tests.lock", "--out", wait=True):
        wanted = requests(load_suite(cell.suite), cell.task, cell.recipe)
        shards = missing_shards(cache, cell.suite, [(cell.task.name, request) for request in wanted])
        for _ in build(shards, workers=1):
            pass


def make_job(cell: Cell, seeds: Sequence[int], out: Path, cache: Path) -> Job:
    """A job on the CPU whose data is there."""
    provide_data(cell, cache)
    return Job(cell, tuple(seeds), out, cache, "cpu")


def finish(job: Job, stop: Callable[[], bool] = never) -> list[Advance | Recorded | TrainedElsewhere]:
    """Carry out a job and return what it reported."""
    return list(run_job(job, stop))


def records_of(job: Job) -> list[Record]:
    """The records that a job left, in seed order."""
    found = []
    for run in job.runs:
        record = read_record(RecordFolder(job.out).path(run))
        assert isinstance(record, Record), record
        found.append(record)
    return found


def batches_at(sampler: StageSampler, step: int) -> tuple[Batch, Batch]:
    """The batches of one step."""
    sampler.draws.move_to(step, sampler.draws.refill)
    batches = sampler.batches(sampler.expert_rows(step))
    sampler.draws.advance()
    return batches


class FakeConfig(MethodConfig):
    """What a fake method does, and when."""

    poisoned_seed: int = ConfigField(-1, description="Seed that goes NaN.")
    poisoned_step: int = ConfigField(0, description="Update at which it does.")
    where: Literal["state", "metrics", "action"] = ConfigField("state", description="What goes NaN.")
    marker: str = ConfigField("", description="File whose presence makes an update exit the process.")


class Drifting(Method):
    """A linear policy whose weights drift with the batches it sees; every row is computed on its own."""

    name = "drifting"
    Config = FakeConfig
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {"released": {}, "paper": {}}

    @classmethod
    def needs(cls, config: FakeConfig) -> DataNeeds:
        return DataNeeds(offline=("observation", "action"), expert=("observation",))

    def __init__(self, config: FakeConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.seeds = list(seeds)
        self.factor = torch.ones(len(seeds), 1, 1)
        self.drifts = torch.zeros(())
        start = torch.tensor([float(seed + 1) for seed in seeds], device=device)
        self.weight = start[:, None, None] * torch.linspace(0.1, 0.3, shapes.observation * shapes.action).view(
            1, shapes.observation, shapes.action
        )

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        return (Stage("warm-up", 7, 4, 0), Stage("drift", None, 8, 4))

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        drift = offline["observation"].mean((1, 2)) + randomness.normal("drift", 1)[:, 0]
        if expert:
            drift = drift + expert["observation"].mean((1, 2))
        self.weight += 0.01 * drift[:, None, None]
        if stage == "drift" and self.drifts >= self.config.poisoned_step:
            for index, seed in enumerate(self.seeds):
                if seed == self.config.poisoned_seed:
                    {"state": self.weight, "metrics": drift, "action": self.factor}[self.config.where][index] = (
                        torch.nan
                    )
        self.drifts += stage == "drift"
        return {"drift": drift}

    def act(self, observation: Tensor) -> Tensor:
        return torch.tanh((observation[..., None] * self.weight[:, None]).sum(-2)) * self.factor


class Silent(Drifting):
    """Reports no metric."""

    name = "silent"

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        super().update(stage, offline, expert, randomness)
        return {}


class Dying(Drifting):
    """Takes its process along when told to."""

    name = "dying"

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        if self.config.marker and Path(self.config.marker).exists():
            os._exit(7)
        return super().update(stage, offline, expert, randomness)


class Raising(Drifting):
    """Has an ordinary bug."""

    name = "raising"

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        raise RuntimeError("a bug in somebody's method")
