"""Checkpoints: everything that a killed run needs to continue bit for bit, in one file per seed.

Seeds that trained together may go on apart, or in other company: a run's checkpoint does not know its neighbours.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from pydantic import BaseModel, ConfigDict

from lfobench.engine.state import SeedState
from lfobench.record import Evaluation, Metrics
from lfobench.tensor_files import DamagedFile, read_tensors, write_tensors

if TYPE_CHECKING:
    from torch import Tensor

METRIC_SUM = "metric sum: "
SECONDS_BETWEEN = 120.0


class Progress(BaseModel):
    """Progress of a job; the part of a checkpoint that is not tensors.

    Attributes:
        stage: index of the running stage.
        step: updates of that stage done.
        evaluations: per seed, those done.
        metrics: per seed, the rows written.
        diverged_at: per seed, the step of the main stage at which it was found diverged, or None.
        seconds: time spent by all sittings so far, by kind; provenance only.
    """

    model_config = ConfigDict(extra="forbid")

    stage: int = 0
    step: int = 0
    evaluations: list[list[Evaluation]]
    metrics: list[list[Metrics]]
    diverged_at: list[int | None]
    seconds: dict[str, float]

    @classmethod
    def start(cls, seeds: int) -> Progress:
        """Nothing done yet."""
        return cls(
            evaluations=[[] for _ in range(seeds)],
            metrics=[[] for _ in range(seeds)],
            diverged_at=[None] * seeds,
            seconds={"train": 0.0, "evaluate": 0.0},
        )

    @property
    def place(self) -> tuple[int, int]:
        """Stage and step."""
        return self.stage, self.step

    def begin_stage(self, stage: int) -> None:
        """Stand at the start of a stage."""
        self.stage, self.step = stage, 0

    def of_seed(self, index: int) -> Progress:
        """One seed's part."""
        return Progress(
            stage=self.stage,
            step=self.step,
            evaluations=[self.evaluations[index]],
            metrics=[self.metrics[index]],
            diverged_at=[self.diverged_at[index]],
            seconds=self.seconds,
        )


def joined(parts: Sequence[Progress]) -> Progress:
    """The progress of seeds that stand at the same step; of their times the longest."""
    return Progress(
        stage=parts[0].stage,
        step=parts[0].step,
        evaluations=[each for part in parts for each in part.evaluations],
        metrics=[each for part in parts for each in part.metrics],
        diverged_at=[each for part in parts for each in part.diverged_at],
        seconds={kind: max(part.seconds.get(kind, 0.0) for part in parts) for kind in parts[0].seconds},
    )


@dataclass(frozen=True)
class Checkpoint:
    """One seed's.

    Attributes:
        progress: of this seed alone.
        state: of the method.
        sums: of the metrics since their last row, by name; ``[]`` each.
    """

    progress: Progress
    state: SeedState
    sums: Mapping[str, Tensor]


def joined_sums(parts: Sequence[Checkpoint]) -> dict[str, Tensor]:
    """The metric sums ``[S]`` of seeds that stand at the same step; empty without parts."""
    names = parts[0].sums if parts else ()
    return {name: torch.stack([each.sums[name] for each in parts]) for name in names}


class Checkpoints:
    """The checkpoint files of seeds that train together.

    Args:
        files: per seed, its path and the key that hashes everything its numbers depend on.
    """

    def __init__(self, files: Sequence[tuple[Path, str]]) -> None:
        self._files = files
        self._saved = time.monotonic()

    @property
    def due(self) -> bool:
        """True if the last ones are so old that work worth keeping would be lost."""
        return time.monotonic() - self._saved > SECONDS_BETWEEN

    def save(self, progress: Progress, states: Sequence[SeedState], sums: Mapping[str, Tensor]) -> None:
        """Write one file per seed, each whole or not at all.

        Args:
            progress: of all seeds.
            states: of the method, per seed.
            sums: of the metrics since their last row, ``[S]`` each.
        """
        sums = {name: total.cpu() for name, total in sums.items()}
        for index, (state, (path, key)) in enumerate(zip(states, self._files, strict=True)):
            of_seed = {name: total[index].clone() for name, total in sums.items()}
            save(path, key, Checkpoint(progress.of_seed(index), state, of_seed))
        self._saved = time.monotonic()


def save(path: Path, key: str, checkpoint: Checkpoint) -> None:
    """Write a checkpoint, whole or not at all; `key` hashes everything that its numbers depend on.

    Raises:
        UserError: when the disk refuses.
    """
    tensors = {**checkpoint.state.tensors, **{METRIC_SUM + name: total for name, total in checkpoint.sums.items()}}
    progress, values = checkpoint.progress.model_dump(mode="json"), checkpoint.state.values
    write_tensors(path, tensors, {"key": key, "progress": progress, "values": values})


def load(path: Path, key: str) -> Checkpoint | None:
    """A checkpoint made under the same key; None when there is none that can be read.

    One that cannot be read is as good as none: the run starts afresh, which costs time and changes no number.
    """
    try:
        tensors, about = read_tensors(path)
        if about["key"] != key:
            return None
        progress = Progress.model_validate(about["progress"])
        values = dict(about["values"])
    except (DamagedFile, OSError, KeyError, TypeError, ValueError):
        return None
    sums = {name.removeprefix(METRIC_SUM): tensors.pop(name) for name in list(tensors) if name.startswith(METRIC_SUM)}
    return Checkpoint(progress, SeedState(tensors, values), sums)
