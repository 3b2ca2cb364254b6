"""What a method offers the harness and what it gets from it.

A method is one class in one file. It declares what it must see (`DataNeeds`); it is handed batches that hold
those fields and nothing else. It knows nothing of files, suites, environments or printing.

Every tensor has a leading seed axis: parameters ``[S, ...]``, batches ``[S, B, ...]``, metrics ``[S]``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import torch
from pydantic import BaseModel, ConfigDict, PositiveInt, Strict
from torch import Tensor

from lfobench.contract.randomness import StepRandomness

Field = Literal[
    "observation",
    "action",
    "next_observation",
    "second_next_observation",
    "terminated",
    "initial_observation",
]
Batch = Mapping[Field, Tensor]
Metrics = dict[str, Tensor]
State = dict[str, Tensor]

Boundary = Literal["released", "exact"]
Termination = Literal["teleport", "zero", "absorbing"]
PresetName = Literal["released", "paper"]


Widths = tuple[Annotated[PositiveInt, Strict()], ...]


class MethodConfig(BaseModel):
    """Hyperparameters of a method; every field carries its own description."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True)
class DataNeeds:
    """What a method must see, and in which form (data/boundaries.py defines the rules by name).

    Attributes:
        offline: fields of an offline batch.
        expert: fields of an expert batch; may name ``action`` only if the method declares its access.
        boundary: which rows exist: ``released`` (the authors' readers, quirks included) or ``exact``.
        termination: what follows a terminal step.
        standardize: whether observations are shifted and scaled by the offline data's mean and std.
    """

    offline: tuple[Field, ...]
    expert: tuple[Field, ...] = ()
    boundary: Boundary = "released"
    termination: Termination = "teleport"
    standardize: bool = False


@dataclass(frozen=True)
class Shapes:
    """Sizes of one observation (after any absorbing indicator) and one action vector."""

    observation: int
    action: int


@dataclass(frozen=True)
class Sizes:
    """Rows that can be sampled from each part of the data."""

    offline: int
    expert: int


@dataclass(frozen=True)
class Stage:
    """A stretch of training with its own update.

    Attributes:
        name: shown in progress, used to key random draws.
        steps: updates; None in a method's last stage, whose length the protocol decides.
        offline_batch: offline rows per seed and update, drawn with replacement; 0 for none.
        expert_batch: expert rows per seed and update; 0 for none.
        expert_epochs: draw expert rows in shuffled passes (last batch of a pass short) instead of with
            replacement.
        period: updates after which the update's operations repeat, for one that does not do the same at every step.
    """

    name: str
    steps: int | None
    offline_batch: int
    expert_batch: int
    expert_epochs: bool = False
    period: int = 1


class Method(ABC):
    """One learning algorithm training all its seeds at once.

    Class attributes:
        name: what ``--methods`` takes.
        version: raised whenever the numbers a method produces change; part of every run's identity.
        access_to_expert_actions: the column group of the seed paper's Table 1. Cloning the mixed offline data
            counts as access there. Only a method that declares it may ask for expert actions.
        Config: the hyperparameters; their defaults are the ``released`` preset.
        presets: per preset, the fields that differ from the defaults, with the values of methods.md.
        stated: configuration fields that every footnote names, because the method's numbers mean little without them
            (methods.md 10, item 5).
        budgets: per protocol, the fields that it changes to fit its budget; printed in every footnote.
        grids: fields and the values among which ``lfobench tune`` chooses, where the task declares none for the method.
    """

    name: ClassVar[str]
    version: ClassVar[int] = 1
    access_to_expert_actions: ClassVar[bool] = False
    Config: ClassVar[type[MethodConfig]]
    presets: ClassVar[Mapping[PresetName, Mapping[str, Any]]]
    stated: ClassVar[tuple[str, ...]] = ()
    budgets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    grids: ClassVar[Mapping[str, tuple[Any, ...]]] = {}

    @classmethod
    @abstractmethod
    def needs(cls, config: Any) -> DataNeeds:
        """What this configuration must see."""

    @abstractmethod
    def __init__(self, config: Any, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        """Build networks and optimisers for all seeds."""

    @abstractmethod
    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """Training from start to end; only the last stage has no length of its own."""

    @abstractmethod
    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """One gradient step of `stage` for every seed.

        It must be made of tensor operations on its arguments and on `state`, in place: an engine may record them once
        and replay them (as a CUDA graph). No value may be read back, and nothing in Python may depend on the step but
        through ``randomness.phase``.

        Args:
            stage: name of the running stage.
            offline: the declared fields, ``[S, B, ...]``.
            expert: the declared fields, ``[S, B, ...]``.
            randomness: this step's draws.

        Returns:
            Metrics ``[S]``, detached, left on the device.
        """

    @abstractmethod
    def act(self, observation: Tensor) -> Tensor:
        """Evaluation actions in [-1, 1], ``[S, N, obs] -> [S, N, act]``, without gradient."""

    @abstractmethod
    def state(self) -> State:
        """Every tensor that training changes, by name: ``[S, ...]``, ``[S*H, ...]`` seed-major, or a scalar.

        The tensors are the live ones: restoring a checkpoint copies into them.
        """
