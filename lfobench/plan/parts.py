"""Parts of the generated source: which rollouts a task reads, described before any is made."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import version
from typing import Any

from lfobench.contract.record import content_hash
from lfobench.contract.suite import Environment, Level, Recipe, Suite, Task
from lfobench.errors import UserError

SHARD_TRANSITIONS = 10_000
FORMAT = 2


def simulator_versions() -> dict[str, str]:
    """Versions that decide the dynamics of the locomotion environments."""
    return {package: version(package) for package in ("gymnasium", "mujoco")}


@dataclass(frozen=True)
class PartSpecification:
    """Everything that decides a part's content; its hash names the part's folder."""

    environment: Environment
    level: Level
    demonstrator: str
    simulator: tuple[tuple[str, str], ...]
    seed: int
    shard_transitions: int = SHARD_TRANSITIONS
    format: int = FORMAT

    @cached_property
    def identity(self) -> dict[str, Any]:
        """As plain JSON data."""
        environment = {"id": self.environment.id, "horizon": self.environment.horizon}
        environment["arguments"] = dict(self.environment.arguments)
        return {**asdict(self), "environment": environment, "simulator": dict(self.simulator)}

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the identity."""
        return content_hash(self.identity)

    @property
    def folder(self) -> str:
        """Folder name in the cache, e.g. ``hopper-random-1a2b3c4d5e``."""
        return f"{self.environment.name}-{self.level}-{self.hash[:10]}"

    def shards_for(self, transitions: int) -> int:
        """Shards that certainly hold that many transitions."""
        return -(-transitions // self.shard_transitions)


@dataclass(frozen=True)
class PartRequest:
    """A part and how many of its transitions a task reads."""

    specification: PartSpecification
    transitions: int


def specification(suite: Suite, task: Task, level: Level) -> PartSpecification:
    """The generated part of a task's environment at one level.

    Raises:
        UserError: when the suite's demonstrator cannot be had.
    """
    try:
        fingerprint = suite.demonstrator(task.environment.name, level).fingerprint
    except UserError:
        raise
    except Exception as error:
        raise UserError(
            f"The {level} demonstrator of {task.environment.name} failed: {type(error).__name__}: {error}.",
            f"Mend the demonstrator of suite '{suite.name}'.",
        ) from error
    return PartSpecification(
        environment=task.environment,
        level=level,
        demonstrator=fingerprint,
        simulator=tuple(sorted(simulator_versions().items())),
        seed=suite.generation_seeds.get(task.environment.name, 0),
    )


def build_command(suite: str, protocol: str, task: str | None = None) -> str:
    """What a user types to make the data of a suite (by name or path), or of one task, under a protocol."""
    return shlex.join(
        ["lfobench", "data", "build", suite, "--protocol", protocol, *(() if task is None else ("--tasks", task))]
    )


def requests(suite: Suite, task: Task, recipe: Recipe) -> tuple[PartRequest, PartRequest]:
    """The offline and the expert part that a recipe reads.

    The released walk counts a trajectory every H of its rows, but a timed-out episode has only H - 1 of them
    (methods.md 2.4): K counts take up to K H / (H - 1) episodes, and one more for the triples at the seam.
    """
    horizon = task.environment.horizon
    episodes = -(-recipe.expert_trajectories * horizon // max(horizon - 1, 1)) + 1
    expert_transitions = episodes * horizon
    return (
        PartRequest(specification(suite, task, recipe.offline), recipe.offline_transitions),
        PartRequest(specification(suite, task, recipe.expert), expert_transitions),
    )
