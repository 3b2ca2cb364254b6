"""Contract of a suite: environments, data recipes and tasks. Plain data, no files, no printing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from lfobench.contract.environment import Environment
from lfobench.contract.episodes import Episodes, FloatArray

__all__ = [
    "Budget",
    "DataFile",
    "Demonstrator",
    "Environment",
    "Files",
    "FloatArray",
    "Level",
    "Recipe",
    "ScriptedDemonstrator",
    "Settings",
    "Suite",
    "Task",
    "own_file",
]

Level = str
"""Quality of a part of the data, as the suite calls it: ``random``, ``medium``, ``expert``, …"""


@dataclass(frozen=True)
class Recipe:
    """Composition of the offline data and of the demonstrations.

    Attributes:
        offline: level of the suboptimal part of the offline data.
        offline_transitions: raw transitions of that part; None where it is counted in trajectories.
        expert: level of the expert part.
        expert_trajectories: K, the number of first trajectories of the expert part that join the offline data, with
            their actions; all, if there are fewer.
        demonstration_rows: where given, the demonstration is this number of first rows of the expert part under
            ``released`` boundaries, wherever its trajectories end, as in the published readers, and its first
            trajectory under ``exact`` ones. Trajectories of another length give methods different demonstrations.
        demonstrations: otherwise, the number of first trajectories that every method observes.
        offline_trajectories: trajectories of the suboptimal part, in place of its transitions.
        expert_transitions: where given, the number of (s, s', s'') of the demonstrations that are observed, drawn
            uniformly and in random order.
        expert_actions: whether demonstrations have actions; those of a tracked hand have none.
        success_share: of the offline trajectories, as their level has it by construction; None where nobody chose it.
        equal_transitions: cut the suboptimal part to as many transitions as the demonstrations have.
        standardize: shift and scale observations by the offline data's mean and standard deviation for every method,
            whatever it declares: in metres, a step is a hundredth of the scale that networks are initialised for.
        exact: use exact boundaries for every method, whatever it declares: the quirks of the published readers belong
            to other data.
    """

    offline: Level
    offline_transitions: int | None
    expert: Level
    expert_trajectories: int
    demonstration_rows: int | None = None
    demonstrations: int = 1
    offline_trajectories: int | None = None
    expert_transitions: int | None = None
    expert_actions: bool = True
    success_share: float | None = None
    equal_transitions: bool = False
    standardize: bool = False
    exact: bool = False

    @classmethod
    def recorded(
        cls, offline: Level, offline_trajectories: int, expert: Level, demonstrations: int, **others: Any
    ) -> Recipe:
        """Recipe of recorded trajectories; the expert's are observed and do not join the offline data.

        Args:
            offline: level of the offline data.
            offline_trajectories: its number of trajectories.
            expert: level of the demonstrations.
            demonstrations: their number; all of them are observed.
            others: further fields of a recipe.
        """
        return cls(
            offline,
            None,
            expert,
            0,
            demonstrations=demonstrations,
            offline_trajectories=offline_trajectories,
            exact=True,
            **others,
        )

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least = int(name != "expert_trajectories")
            if type(value) is int and value < least:
                raise ValueError(f"a recipe's {name} is {value}; it must be at least {least}")
        if (self.offline_transitions is None) == (self.offline_trajectories is None):
            raise ValueError("a recipe counts its offline part either in transitions or in trajectories")
        if self.demonstration_rows is not None and (self.exact or self.demonstrations != 1):
            raise ValueError("a recipe counts demonstrations either in rows, as published, or in trajectories")
        if self.expert_transitions is not None and not self.exact:
            raise ValueError("a recipe that samples expert_transitions must be exact")
        if self.expert_trajectories and not self.expert_actions:
            raise ValueError("a recipe's expert_trajectories cannot join the offline data without actions")

    @property
    def observed(self) -> int:
        """Trajectories that are observed, where no rows are counted."""
        return 1 if self.demonstration_rows is not None else self.demonstrations


GENERATED = "generated"
"""Name of the source that the suite generates; any other one is read from files."""


@dataclass(frozen=True)
class DataFile:
    """A file, or the folder of a dataset.

    Attributes:
        name: its name in the source, e.g. ``hopper-random-v2``.
        addresses: of downloads, in the order in which they are tried.
        path: of the file; None for a published one that is not on this machine.
        sha256: of its bytes, where it is on this machine.
        columns: number of first columns of an observation that are read; None reads all. D4RL's ant has 84 columns of
            zeros.
        keys: names of the arrays that make up an observation, in this order, where the file has a dictionary of them;
            None takes the usual ones of its layout.
    """

    name: str
    addresses: tuple[str, ...] = ()
    path: str | None = None
    sha256: str | None = None
    columns: int | None = None
    keys: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if not self.addresses and self.path is None:
            raise ValueError(f"data file '{self.name}' has neither an address nor a path")
        if self.columns is not None and self.columns < 1:
            raise ValueError(f"data file '{self.name}' has columns = {self.columns}; it must be at least 1")
        if self.keys is not None:
            check_keys(self.keys)


def check_keys(keys: object) -> None:
    """Refuse keys that are not a tuple of distinct names.

    Raises:
        ValueError: with the expected form.
    """
    if not isinstance(keys, tuple) or not all(isinstance(key, str) and key and key.isprintable() for key in keys):
        raise ValueError(f"keys are {keys!a}; they should be a tuple of names")
    if not keys or len(set(keys)) < len(keys):
        raise ValueError(f"keys are {keys!a}; at least one is named, and none twice")


def own_file(path: str | Path, keys: tuple[str, ...] | None = None) -> DataFile:
    """A user's file, named after its path; ``~`` is the home folder, and `keys` are those of `DataFile`.

    Raises:
        ValueError: the path is relative, and would mean another file in another working folder; or it has characters
            that cannot be written into a record.
    """
    place = Path(path).expanduser()
    if not str(place).isprintable():
        raise ValueError(f"{str(place)!a} cannot be written down; name a link to it that can")
    if not place.is_absolute():
        raise ValueError(f"{path} is relative; write Path(__file__).parent / {str(path)!r} for one next to the suite")
    return DataFile(place.stem or str(place), path=str(place), keys=keys)


@dataclass(frozen=True)
class Files:
    """Files of a task's data, in place of generated parts.

    Attributes:
        offline: file of the suboptimal part; None generates it.
        expert: file of the expert part; None generates it.
        environment: for policies trained on these files; None keeps the task's.
        recipe: of these files; None keeps the task's.
        group: block of rows, where the task's own group is named after generated levels; None keeps the task's.
        returns: whether the rewards in the files sum to the environment's returns; D4RL's kitchen rewards every step
            after a completion. If not, the data has no score. No method sees rewards.
    """

    offline: DataFile | None = None
    expert: DataFile | None = None
    environment: Environment | None = None
    recipe: Recipe | None = None
    group: str | None = None
    returns: bool = True

    def __post_init__(self) -> None:
        if self.offline is None and self.expert is None:
            raise ValueError("neither the offline nor the expert part is a file")


Role = Literal["obstacle", "goal"]
Span = tuple[float, float]


@dataclass(frozen=True)
class Disc:
    """A fixed disc in a scene.

    Attributes:
        name: e.g. ``cup``.
        role: obstacle to avoid, or goal to reach.
        center: (x, y) in metres.
        radius: metres.
    """

    name: str
    role: Role
    center: tuple[float, float]
    radius: float


@dataclass(frozen=True)
class Scene:
    """Top view of a table; lengths in metres.

    An environment with a scene reports true positions in every step's ``info``: ``effector`` ``[2]`` and, where there
    is one, ``puck`` ``[2]``.

    Attributes:
        x: extent along the table, which slopes down towards `downhill`.
        y: extent across it.
        downhill: -1 or 1, the sign of x towards which a free puck accelerates.
        workspace: (x, y) extents of the end-effector's positions.
        discs: objects on the table.
        stride: metres along x and y that an action of 1 commands.
        effector_radius: of the tool at the end-effector.
        puck_radius: None where there is no puck.
        observation_at: observations ``[n, obs]`` of the end-effector at rest at positions ``[n, 2]``, for a field of
            actions; None where an observation holds more than that position.
    """

    x: Span
    y: Span
    downhill: Literal[-1, 1]
    workspace: tuple[Span, Span]
    discs: tuple[Disc, ...]
    stride: tuple[float, float]
    effector_radius: float
    puck_radius: float | None = None
    observation_at: Callable[[FloatArray], FloatArray] | None = None


class Demonstrator(Protocol):
    """A policy that generates a part of the data."""

    @property
    def fingerprint(self) -> str:
        """Hash of everything that decides the actions; equal fingerprints act alike."""
        ...

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """An action ``[act]`` for one observation ``[obs]``, both in the environment's units, by `generator`."""
        ...


@runtime_checkable
class ScriptedDemonstrator(Protocol):
    """A demonstrator that records whole episodes, with its own starts, pace and mistakes."""

    @property
    def fingerprint(self) -> str:
        """Hash of everything that decides the episodes; equal fingerprints record alike."""
        ...

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        """Recorded episodes, `episodes` of them, in the environment's units.

        Their actions are NaN where nothing was commanded (a hand-held object).
        """
        ...


@dataclass(frozen=True)
class Budget:
    """Training and evaluation budget of a task under one protocol, for tasks of unusual size.

    Attributes:
        steps: gradient steps of a method's last stage.
        evaluation_every: steps between evaluations.
        evaluation_episodes: the fixed test starts.
        further_episodes: further starts, for one final evaluation of the trained policy.
        methods: protocol whose settings of the methods apply; None takes this protocol's own.
    """

    steps: int
    evaluation_every: int
    evaluation_episodes: int
    further_episodes: int = 0
    methods: str | None = None

    def __post_init__(self) -> None:
        for name, least in (("steps", 1), ("evaluation_every", 1), ("evaluation_episodes", 1), ("further_episodes", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"a budget's {name} is {getattr(self, name)}; it must be at least {least}")


Settings = Mapping[str, Mapping[str, Any]]
"""Method name to fields of its configuration and their values."""


@dataclass(frozen=True)
class Task:
    """One row of a table: an environment and a data recipe.

    Attributes:
        name: e.g. ``hopper-random-expert``.
        group: block of rows in a table, e.g. ``random+expert``.
        environment: for the evaluation of policies.
        recipe: of the training data.
        paper_steps: gradient steps under the protocol ``paper``.
        budgets: protocol name to its budget for this task; protocols that are not named keep their own.
        settings: fields of methods for this task's data, which override presets and protocols.
        without_expert: methods whose authors' code mixes no expert trajectory into this task's offline data.
        grids: per method, the values of fields among which ``lfobench tune`` chooses.
        files: source name, e.g. ``d4rl``, to its files.
        read_from: files of the chosen source; None generates the data.
        simulator: packages, besides gymnasium and mujoco, whose versions decide the dynamics.
        published_starts: how many of the fixed test starts, the first ones, a publication has.
    """

    name: str
    group: str
    environment: Environment
    recipe: Recipe
    paper_steps: int
    budgets: Mapping[str, Budget] = field(default_factory=dict)
    settings: Settings = field(default_factory=dict)
    without_expert: tuple[str, ...] = ()
    grids: Mapping[str, Mapping[str, tuple[Any, ...]]] = field(default_factory=dict)
    files: Mapping[str, Files] = field(default_factory=dict)
    read_from: Files | None = None
    simulator: tuple[str, ...] = ()
    published_starts: int | None = None

    def __post_init__(self) -> None:
        if self.paper_steps < 1:
            raise ValueError(f"task '{self.name}' has paper_steps {self.paper_steps}; it must be at least 1")


@dataclass(frozen=True)
class Suite:
    """A named list of tasks and the demonstrators that make their generated data.

    Attributes:
        name: argument of ``--suite``.
        summary: one line for ``lfobench ls suites``.
        tasks: in table order.
        demonstrator: environment name and level to the policy or scripted demonstrator that generates the data; None
            where no data can be generated.
        generation_seeds: environment name to the seed of its generated data; 0 where not named.
        scene: environment name to its top view; None where there is none.
    """

    name: str
    summary: str
    tasks: tuple[Task, ...]
    demonstrator: Callable[[str, Level], Demonstrator | ScriptedDemonstrator] | None
    generation_seeds: Mapping[str, int] = field(default_factory=dict)
    scene: Callable[[str], Scene] | None = None

    def __post_init__(self) -> None:
        names = [task.name for task in self.tasks]
        if not names:
            raise ValueError(f"suite '{self.name}' has no task")
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"suite '{self.name}' has two tasks named {', '.join(repeated)}")
