"""The contract between a method and the harness.

A method is one class in one file. It declares the data that it must see (`DataNeeds`); it is handed batches with
those fields and nothing else. It knows nothing of files, suites, environments or printing.

Batches, metrics and actions have a leading seed axis: ``[S, B, ...]``, ``[S]``, ``[S, N, act]``. Parameters may have
one too (``[S, ...]``, as in `lfobench.nn.networks`: fast), or be ordinary modules, one per seed
(`lfobench.nn.modules.PerSeed`: slower, just as right).

A minimal method has `name`, `Config`, `needs`, `__init__`, `update` and `act`; everything else has a default.
"""

from __future__ import annotations

import hashlib
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, PositiveInt, Strict

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from lfobench.randomness import StepRandomness

Field = Literal[
    "observation",
    "action",
    "next_observation",
    "second_next_observation",
    "terminated",
    "initial_observation",
    "label",
]
Batch: TypeAlias = "Mapping[Field, Tensor]"
Metrics: TypeAlias = "dict[str, Tensor]"
State: TypeAlias = "dict[str, Tensor]"

Boundary = Literal["released", "exact"]
Termination = Literal["teleport", "zero", "absorbing"]
PresetName = str
DEFAULT_BATCH = 256


Widths = tuple[Annotated[PositiveInt, Strict()], ...]


class MethodConfig(BaseModel):
    """Hyperparameters of a method; every field carries its own description.

    Class attributes:
        later: fields that came when records without them existed, and whose default is what those records were made
            with. They enter a run's identity only where they differ from it, so that the old records are still found.
    """

    later: ClassVar[frozenset[str]] = frozenset()

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def identity(self) -> dict[str, Any]:
        """The fields as plain JSON data, as a run's identity holds them."""
        defaults = {name: self.__class__.model_fields[name].default for name in self.later}
        silent = {name for name, default in defaults.items() if getattr(self, name) == default}
        return self.model_dump(mode="json", exclude=silent)


class UnsuitableData(ValueError):
    """Raised by `Method.prepare` for data that cannot give what the method needs.

    Args:
        cause: one sentence that names what is missing.
        remedy: one sentence that says what to do.
    """

    def __init__(self, cause: str, remedy: str) -> None:
        super().__init__(cause)
        self.remedy = remedy


WHOLE_RUN = "whole run"


def budget_fields(declared: Mapping[str, Any], steps: int | None) -> dict[str, Any]:
    """The fields of a declared budget, for a run whose last stage has so many steps; None where no run decides them."""
    return {name: steps if isinstance(value, str) and value == WHOLE_RUN else value for name, value in declared.items()}


@dataclass(frozen=True)
class DataNeeds:
    """Data that a method must see, and in which form (lfobench/data/boundaries.py defines the rules by name).

    Attributes:
        offline: fields of an offline batch; ``label`` is what the method's `prepare` computed.
        expert: fields of an expert batch; may name ``action`` only if the method declares its access.
        boundary: which rows exist: ``released`` (the authors' readers, quirks included) or ``exact``.
        termination: what follows a terminal step.
        standardize: whether observations are shifted and scaled by the offline data's mean and std.
        expert_joins: whether the expert trajectories that a recipe mixes into the offline data are in it.
    """

    offline: tuple[Field, ...]
    expert: tuple[Field, ...] = ()
    boundary: Boundary = "released"
    termination: Termination = "teleport"
    standardize: bool = False
    expert_joins: bool = True


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
class Trajectories:
    """One part of the data as whole trajectories, for `Method.prepare`.

    They come in an order that says nothing about where they are from; rewards do not exist here. Observations are
    those of the batches: standardised, or with an absorbing indicator, where the method asks for it.

    Attributes:
        observations: ``[N + E, obs]``; a trajectory of T steps owns T + 1 rows, the last of them NaN where the data
            does not hold the observation it ended in.
        actions: ``[N, act]``; None where the method's `needs` do not name them for this part.
        lengths: ``[E]`` steps of each trajectory.
        terminated: ``[E]``; True where the environment ended the trajectory, False where time ran out or it was cut.
    """

    observations: Tensor
    actions: Tensor | None
    lengths: Tensor
    terminated: Tensor

    def split(self) -> list[Tensor]:
        """The observations ``[T + 1, obs]`` of every trajectory."""
        return list(self.observations.split((self.lengths + 1).tolist()))


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

    The harness finds what training changes by itself: tensors, networks and optimisers of `lfobench.nn`,
    `torch.nn.Module`, `torch.optim.Optimizer` and plain numbers that the method holds, directly, in containers or in
    other objects, as one for all seeds or as a list with one per seed. It must all exist when `__init__` returns.

    Class attributes:
        name: what ``--methods`` takes.
        version: raised whenever the numbers of a method that ships with lfobench change; part of every run's identity.
            A method from elsewhere is identified by its source files as well.
        access_to_expert_actions: the column group in Table 1 of DILO's paper. Cloning the mixed offline data
            counts as access there. Only a method that declares it may ask for expert actions.
        Config: the hyperparameters; their defaults are the ``released`` preset.
        presets: per preset, the fields that differ from the defaults.
        stated: configuration fields that every footnote names, because the method's numbers mean little without them.
        budgets: per protocol, the fields that it changes to fit its budget; printed in every footnote. `WHOLE_RUN` as
            a value stands for the steps of a run's last stage, whatever decides them.
        grids: fields and the values among which ``lfobench tune`` chooses, where the task declares none for the method.

    Attributes:
        config: of this instance; set before `__init__` runs.
    """

    name: ClassVar[str]
    version: ClassVar[int] = 1
    access_to_expert_actions: ClassVar[bool] = False
    Config: ClassVar[type[MethodConfig]]
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {"released": {}}
    stated: ClassVar[tuple[str, ...]] = ()
    budgets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    grids: ClassVar[Mapping[str, tuple[Any, ...]]] = {}

    config: Any
    _source: ClassVar[str | None]
    """SHA-256 of the file that the class was made from; None where it has none."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Remember the file as it is now, since it may be edited while the class lives."""
        super().__init_subclass__(**keywords)
        file = Path(getattr(sys.modules.get(cls.__module__), "__file__", None) or "")
        cls._source = hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None

    def __new__(cls, config: Any = None, *_: Any, **__: Any) -> Self:
        """An instance that knows its configuration, whatever its own `__init__` keeps."""
        method = super().__new__(cls)
        method.config = config
        return method

    @classmethod
    @abstractmethod
    def needs(cls, config: Any) -> DataNeeds:
        """The data that this configuration must see."""

    @classmethod
    def prepare(
        cls,
        config: Any,
        offline: Trajectories,
        expert: Trajectories,
        seeds: Sequence[int],
        progress: Callable[[float], None],
    ) -> Tensor:
        """Labels of the offline transitions, computed once from the whole data before training.

        Called only where `needs` names ``label`` among the offline fields; every batch then holds the labels of its
        rows under that name. They must be a function of the arguments alone: they are cached under a hash of the
        data, the configuration, the method's code and, where they differ between seeds, the seed.

        Args:
            config: of the method.
            offline: on the training device; no rewards, nothing about where a trajectory is from.
            expert: the demonstrations; actions only for a method that declares its access.
            seeds: the seed axis.
            progress: to be called now and then with the part that is done, in [0, 1]; it may raise to end the work.

        Returns:
            ``[N]`` for all seeds, or ``[S, N]``, in the order of the transitions of `offline`; float32, finite.

        Raises:
            UnsuitableData: the data cannot give what the method needs.
        """
        raise NotImplementedError(f"{cls.name} asks for labels and has no `prepare`")

    @abstractmethod
    def __init__(self, config: Any, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        """Networks and optimisers for all seeds."""

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """Training from start to end; only the last stage has no length of its own.

        By default one stage, ``policy``, with `config.batch_size` rows (256 where there is no such field) of each part
        whose fields the method needs.
        """
        needs, rows = self.needs(self.config), getattr(self.config, "batch_size", DEFAULT_BATCH)
        return (Stage("policy", None, rows if needs.offline else 0, rows if needs.expert else 0),)

    @abstractmethod
    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """One gradient step of `stage` for every seed.

        On a CUDA device an engine records the operations once and replays them (as a CUDA graph), so they should be
        tensor operations on the arguments and, in place, on what the method holds. An update that reads a value back,
        or counts in Python, runs step by step there, and the record says so.

        Args:
            stage: name of the running stage.
            offline: the declared fields, ``[S, B, ...]``.
            expert: the declared fields, ``[S, B, ...]``.
            randomness: this step's draws; the only source of chance.

        Returns:
            Metrics ``[S]``, detached, left on the device.
        """

    @abstractmethod
    def act(self, observation: Tensor) -> Tensor:
        """Evaluation actions in [-1, 1], ``[S, N, obs] -> [S, N, act]``; called without gradient."""

    def state(self) -> State | None:
        """None: the harness collects the state. A method that keeps it elsewhere returns its live tensors by name.

        Tensors are ``[S, ...]``, ``[S*H, ...]`` seed-major, or the same for all seeds; restoring copies into them.
        """
        return None
