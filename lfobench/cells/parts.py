"""Parts of the generated source: which rollouts a task reads, described before any is made."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from lfobench.contract.suite import DataFile, Environment, Level, Recipe, ScriptedDemonstrator, Suite, Task
from lfobench.errors import UserError
from lfobench.text import content_hash

READERS = 2
"""Grows whenever a reader makes other episodes of the same file."""

MOST_OF_A_NAME = 100
"""Characters; file systems take 255 with the rest."""


@dataclass(frozen=True)
class FilePart:
    """A file's episodes; the hash of what decides them names their folder in the cache.

    Attributes:
        name: what the file is called, e.g. ``hopper-random-v2``.
        sha256: of its bytes; empty of a file that is not here.
        horizon: steps after which an episode is cut, where the file does not say.
        columns: how many of an observation's columns are read; None reads all.
        keys: what an observation is made of; None leaves it to the file's layout.
        readers: version of the readers.
    """

    name: str
    sha256: str
    horizon: int
    columns: int | None = None
    keys: tuple[str, ...] | None = None
    readers: int = READERS

    @property
    def identity(self) -> dict[str, Any]:
        """Identity as plain JSON data, without the file's name and path."""
        if not self.sha256:
            return {"absent": self.name}
        identity = {"sha256": self.sha256, "horizon": self.horizon, "columns": self.columns, "readers": self.readers}
        return identity if self.keys is None else {**identity, "keys": list(self.keys)}

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the identity."""
        return content_hash(self.identity)

    @property
    def level(self) -> str:
        """Name of the part in tables and messages."""
        return self.name

    @property
    def folder(self) -> str:
        """Folder name in the cache, e.g. ``hopper-random-v2-1a2b3c4d5e``."""
        return f"{self.name[:MOST_OF_A_NAME]}-{self.hash[:10]}"

    def shards_for(self, transitions: int | None) -> int:
        """A file is one shard, however much of it is read."""
        return 1


def file_part(file: DataFile, horizon: int) -> FilePart:
    """The part that a file is in an environment of that horizon."""
    return FilePart(file.name, file.sha256 or "", horizon, file.columns, file.keys)


SHARD_TRANSITIONS = 10_000
FORMAT = 2


def simulator_versions(task: Task) -> dict[str, str]:
    """Versions that decide the dynamics of a task's environment.

    Raises:
        UserError: a package that it needs is not installed.
    """
    try:
        return {package: version(package) for package in ("gymnasium", "mujoco", *task.simulator)}
    except PackageNotFoundError as error:
        raise UserError(
            f"Task '{task.name}' needs the package {error.name}, which is not installed.",
            "Install what was tested together: pip install -c constraints.txt -e .",
        ) from error


@dataclass(frozen=True)
class PartSpecification:
    """Everything that decides a part's content; its hash names the part's folder.

    Attributes:
        environment: that the part is from.
        level: of who made it.
        demonstrator: the maker's fingerprint.
        simulator: packages and versions.
        seed: of the part.
        shard_transitions: of a part that is made to any length, in shards.
        format: of its files.
        episodes: of a part that a scripted demonstrator records, in one shard; it decides its episodes by itself, so
            neither the environment's registration nor how it scores is part of the identity.
    """

    environment: Environment
    level: Level
    demonstrator: str
    simulator: tuple[tuple[str, str], ...]
    seed: int
    shard_transitions: int = SHARD_TRANSITIONS
    format: int = FORMAT
    episodes: int | None = None

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Identity as plain JSON data."""
        if self.episodes is not None:
            return {
                "environment": self.environment.name,
                "level": self.level,
                "operator": self.demonstrator,
                "simulator": dict(self.simulator),
                "seed": self.seed,
                "episodes": self.episodes,
                "format": self.format,
            }
        environment = {"id": self.environment.id, "horizon": self.environment.horizon}
        environment["arguments"] = dict(self.environment.arguments)
        fields = {name: value for name, value in asdict(self).items() if name != "episodes"}
        return {**fields, "environment": environment, "simulator": dict(self.simulator)}

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the identity."""
        return content_hash(self.identity)

    @property
    def folder(self) -> str:
        """Folder name in the cache, e.g. ``hopper-random-1a2b3c4d5e``."""
        return f"{self.environment.name}-{self.level}-{self.hash[:10]}"

    def shards_for(self, transitions: int | None) -> int:
        """Shards that certainly hold that many transitions; None asks for the part, whole."""
        return 1 if transitions is None else -(-transitions // self.shard_transitions)


Part = PartSpecification | FilePart
"""Made here, or read from a file."""


@dataclass(frozen=True)
class PartRequest:
    """A part and how many of its transitions a task reads.

    Attributes:
        specification: what the part is.
        transitions: None reads the part whole.
        path: of the file that it is made of, if it is.
        trajectories: the first so many are kept of what was read; None keeps them all.
    """

    specification: Part
    transitions: int | None
    path: str | None = None
    trajectories: int | None = None


def specification(suite: Suite, task: Task, level: Level, episodes: int | None = None) -> PartSpecification:
    """The generated part of a task's environment at one level.

    Args:
        suite: has the demonstrator.
        task: has the environment.
        level: of the demonstrator.
        episodes: how many a scripted demonstrator records; None of a policy.

    Raises:
        UserError: when the suite's demonstrator cannot be had.
    """
    if suite.demonstrator is None:
        raise UserError(
            f"Suite '{suite.name}' cannot generate the {level} part of {task.name}.",
            f"Choose another --source: {', '.join(task.files) or 'offline=PATH,expert=PATH'}.",
        )
    try:
        maker = suite.demonstrator(task.environment.name, level)
        fingerprint = maker.fingerprint
    except UserError:
        raise
    except (Exception, SystemExit) as error:
        raise UserError(
            f"The {level} demonstrator of {task.environment.name} failed: {type(error).__name__}: {error}.",
            f"Fix the demonstrator of suite '{suite.name}'.",
        ) from error
    if isinstance(maker, ScriptedDemonstrator) != (episodes is not None):
        kind = "a scripted demonstrator" if episodes is None else "a policy"
        raise UserError(
            f"The {level} part of {task.name} is made by {kind}, "
            f"and its recipe counts {'transitions' if episodes is None else 'trajectories'}.",
            f"Fix suite '{suite.name}': a Recipe of offline_trajectories goes with scripted demonstrators, one of "
            "offline_transitions with policies.",
        )
    return PartSpecification(
        environment=task.environment,
        level=level,
        demonstrator=fingerprint,
        simulator=tuple(sorted(simulator_versions(task).items())),
        seed=suite.generation_seeds.get(task.environment.name, 0),
        episodes=episodes,
    )


def build_command(suite: str, protocol: str, task: str, source: str = "generated") -> str:
    """Command that makes the data of a suite's task (the suite by name or path), under a protocol."""
    words = ["lfobench", "data", "build", suite, "--protocol", protocol, "--tasks", task]
    return shlex.join(words if source == "generated" else [*words, "--source", source])


def requests(suite: Suite, task: Task, recipe: Recipe) -> tuple[PartRequest, PartRequest]:
    """The offline and the expert part that a recipe reads.

    D4RL's loader counts a trajectory every H of its rows, but a timed-out episode has only H - 1 of them: K counts take
    up to K H / (H - 1) episodes, and one more for the triples at the seam.
    """
    read, horizon = task.read_from, task.environment.horizon
    offline, expert = (None, None) if read is None else (read.offline, read.expert)
    joined, observed = recipe.expert_trajectories, recipe.observed
    if recipe.offline_transitions is None:
        trajectories = recipe.offline_trajectories
        return (
            _request(suite, task, recipe.offline, offline, None, trajectories),
            _request(suite, task, recipe.expert, expert, None, max(joined, observed)),
        )
    episodes = max(-(-joined * horizon // max(horizon - 1, 1)) + 1, observed)
    return (
        _request(suite, task, recipe.offline, offline, recipe.offline_transitions),
        _request(suite, task, recipe.expert, expert, episodes * horizon),
    )


def _request(
    suite: Suite,
    task: Task,
    level: Level,
    file: DataFile | None,
    transitions: int | None,
    trajectories: int | None = None,
) -> PartRequest:
    if file is None:
        return PartRequest(specification(suite, task, level, trajectories), transitions, None, trajectories)
    return PartRequest(file_part(file, task.environment.horizon), transitions, file.path, trajectories)
