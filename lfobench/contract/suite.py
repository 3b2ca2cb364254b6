"""What a suite declares: environments, data recipes and tasks. Plain data, no files, no printing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from lfobench.contract.environment import Environment
from lfobench.contract.episodes import Episodes, FloatArray
from lfobench.text import counted

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
"""How well a part of the data was made, in the suite's own words: ``random``, ``medium``, ``expert``, …"""


@dataclass(frozen=True)
class Recipe:
    """What makes the offline data, and what of the expert is observed.

    Attributes:
        offline: level of who made the poor part of the offline data.
        offline_transitions: raw transitions of that part; None where it is counted in trajectories.
        expert: level of who made the expert part.
        expert_trajectories: K, the first trajectories of the expert part, which join the offline data with their
            actions; all that there are, if those are fewer.
        demonstration_rows: where given, under ``released`` boundaries the first so many rows of the expert part are
            observed, wherever its trajectories end, as by the published readers, and under ``exact`` ones its first
            trajectory. Where trajectories have another length than this, methods see different demonstrations.
        demonstrations: otherwise, how many trajectories are observed, the first ones and the same by every method.
        offline_trajectories: of the poor part, in the place of its transitions.
        expert_transitions: where given, only so many (s, s', s'') of the demonstrations are observed, drawn uniformly
            and in random order.
        expert_actions: whether demonstrations have actions at all; a tracked hand has none.
        equal_transitions: cut the poor part to as many transitions as the demonstrations have.
        standardize: shift and scale observations by the offline data's mean and standard deviation for every method,
            whatever it declares: in metres, a step is a hundredth of what networks are used to.
        exact: whether every boundary is exact, whatever a method declares: the quirks of the published readers belong
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
    equal_transitions: bool = False
    standardize: bool = False
    exact: bool = False

    @classmethod
    def recorded(
        cls, offline: Level, offline_trajectories: int, expert: Level, demonstrations: int, **others: Any
    ) -> Recipe:
        """Recorded trajectories, of which the expert's are observed and join nothing.

        Args:
            offline: level of who recorded the offline data.
            offline_trajectories: recorded for it.
            expert: level of who recorded the demonstrations.
            demonstrations: recorded; all of them are observed.
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

    @property
    def identity(self) -> dict[str, Any]:
        """As plain JSON data, by which records are found: what it once was for a recipe, it must stay.

        A recipe that counts its offline part in trajectories has always called its demonstrations
        `expert_trajectories`, and has spelled more of its fields; any other field is there where it is not as usual.
        """
        usual = {each.name: each.default for each in fields(self) if each.default is not MISSING}
        spelled = {"offline", "expert", "expert_trajectories"}
        values = dict(vars(self))
        if self.offline_trajectories is None:
            counted_in = "demonstrations" if self.demonstration_rows is None else "demonstration_rows"
            spelled |= {"offline_transitions", counted_in}
        else:
            usual |= {"offline_transitions": None, "expert_trajectories_joined": 0, "exact": True}
            values["expert_trajectories_joined"] = self.expert_trajectories
            values["expert_trajectories"] = values.pop("demonstrations")
            spelled |= {"offline_trajectories", "expert_transitions", "expert_actions"}
            spelled |= {"equal_transitions", "standardize"}
        return {name: value for name, value in values.items() if name in spelled or value != usual[name]}

    def capped(self, transitions: int | None, trajectories: int | None) -> Recipe:
        """The recipe with at most so many transitions and so many expert trajectories that join them; None is no cap.

        What is counted in trajectories to begin with is little, and stays as it is.
        """
        if self.offline_transitions is None:
            return self
        return replace(
            self,
            offline_transitions=min(self.offline_transitions, transitions or self.offline_transitions),
            expert_trajectories=min(self.expert_trajectories, trajectories or self.expert_trajectories),
        )

    def most_rows(self, horizon: int) -> tuple[int, int]:
        """Offline and expert rows to train on, if every trajectory runs to the horizon."""
        observed = self.observed * horizon
        offline = self.offline_transitions or (self.offline_trajectories or 0) * horizon
        if self.equal_transitions:
            offline = observed
        return (
            offline + self.expert_trajectories * horizon,
            self.demonstration_rows or self.expert_transitions or observed,
        )

    @property
    def words(self) -> tuple[str, str]:
        """The offline part, and what is taken of the expert."""
        many = f"{self.expert} trajectories"
        offline = (
            f"{self.offline_trajectories} {self.offline} trajectories"
            if self.offline_transitions is None
            else f"{self.offline_transitions:,} {self.offline} transitions"
        )
        joined = counted(self.expert_trajectories, f"{self.expert} trajectory", many)
        if self.demonstration_rows is not None:
            return offline, joined
        sample = "" if self.expert_transitions is None else f"{self.expert_transitions} transitions of "
        if not self.expert_trajectories:
            return offline, sample + counted(self.demonstrations, f"{self.expert} trajectory", many)
        return offline, f"{joined}, {sample}{self.demonstrations} observed"

    @property
    def sentence(self) -> str:
        """Both parts in words, and what is cut."""
        cut = ", the former cut to as many transitions as the latter" if self.equal_transitions else ""
        return f"{' + '.join(self.words)}{cut}"


GENERATED = "generated"
"""The source that is made by the suite; any other one is read from files."""


@dataclass(frozen=True)
class DataFile:
    """A file, or the folder of a dataset.

    Attributes:
        name: what its source calls it, e.g. ``hopper-random-v2``.
        addresses: where it is to be had, the first that answers.
        path: where it lies; None of a published one that is not here.
        sha256: of its bytes, where it is here.
        columns: how many of an observation's columns are read, from the first on; None reads all. D4RL's ant has 84
            that are zero throughout.
        keys: what an observation is made of, in this order, where the file has a dictionary of them; None takes those
            that are usual in its layout.
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
    """Refuse what are no keys of an observation.

    Raises:
        ValueError: saying what they should be.
    """
    if not isinstance(keys, tuple) or not all(isinstance(key, str) and key and key.isprintable() for key in keys):
        raise ValueError(f"keys are {keys!a}; they should be a tuple of names")
    if not keys or len(set(keys)) < len(keys):
        raise ValueError(f"keys are {keys!a}; at least one is named, and none twice")


def own_file(path: str | Path, keys: tuple[str, ...] | None = None) -> DataFile:
    """A user's file, called by its own name; ``~`` is the home folder, and `keys` are as `DataFile` has them.

    Raises:
        ValueError: the path is relative, and would be another file in another working folder; or it cannot
            be written into a record.
    """
    place = Path(path).expanduser()
    if not str(place).isprintable():
        raise ValueError(f"{str(place)!a} cannot be written down; name a link to it that can")
    if not place.is_absolute():
        raise ValueError(f"{path} is relative; write Path(__file__).parent / {str(path)!r} for one beside the suite")
    return DataFile(place.stem or str(place), path=str(place), keys=keys)


@dataclass(frozen=True)
class Files:
    """What a task is read from instead of being generated.

    Attributes:
        offline: the poor part; None generates it.
        expert: the expert part; None generates it.
        environment: where policies are evaluated that learn from it; None keeps the task's.
        recipe: how it is mixed; None keeps the task's.
        group: the block of rows, where the task's own is named by the stand-ins of these data; None keeps the task's.
        returns: whether the rewards in the files add up to what the environment returns; D4RL's kitchen rewards every
            step after a completion. No method sees them; where they do not, no score of the data is told.
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
    """A round thing that stays where it is.

    Attributes:
        name: the field's word for it, e.g. ``cup``.
        role: to be avoided, or to be reached.
        center: (x, y) in metres.
        radius: metres.
    """

    name: str
    role: Role
    center: tuple[float, float]
    radius: float


@dataclass(frozen=True)
class Scene:
    """A table seen from above; every length in metres.

    An environment with a scene reports where things truly are in every step's ``info``: ``effector`` ``[2]`` and, where
    there is one, ``puck`` ``[2]``.

    Attributes:
        x: the table's extent along its length; the table slopes down towards `downhill`.
        y: its extent across.
        downhill: -1 or 1, the sign of x towards which a free puck accelerates.
        workspace: (x, y) extents that the end-effector may reach.
        discs: what stands on it.
        stride: metres along x and y that an action of 1 commands.
        effector_radius: of what the end-effector carries.
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
    """A policy that makes a part of the generated data."""

    @property
    def fingerprint(self) -> str:
        """A hash of everything that decides the actions; two equal fingerprints act alike."""
        ...

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """An action ``[act]`` for one observation ``[obs]``, both in the environment's units, by `generator`."""
        ...


@runtime_checkable
class ScriptedDemonstrator(Protocol):
    """A demonstrator that records whole episodes, with starts, a pace and mistakes of its own."""

    @property
    def fingerprint(self) -> str:
        """A hash of everything that decides the episodes; two equal fingerprints record alike."""
        ...

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        """Recordings of `episodes` episodes, in the environment's units.

        Where nothing was commanded (a hand-held object), their actions are NaN.
        """
        ...


@dataclass(frozen=True)
class Budget:
    """What a protocol means for a task whose size it was not made for.

    Attributes:
        steps: gradient steps of a method's last stage.
        evaluation_every: steps between evaluations.
        evaluation_episodes: the fixed test starts.
        further_episodes: more starts, from which the trained policy alone is run once.
        methods: the protocol whose settings of the methods are taken; None takes this protocol's own.
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
        group: the block of rows it belongs to in a table, e.g. ``random+expert``.
        environment: where policies are evaluated.
        recipe: what they are trained on.
        paper_steps: gradient steps that the seed paper gives this task.
        budgets: protocol name to what it means here; a protocol that is not named means what it always does.
        settings: fields of methods that this task's kind of data asks for, over any preset or protocol.
        without_expert: methods whose authors' code mixes no expert trajectory into this task's offline data.
        grids: per method, the values of fields among which ``lfobench tune`` chooses.
        files: source name to the files that it reads, e.g. ``d4rl``.
        read_from: the files that are read, once a source is chosen; None generates the data.
        simulator: packages beside gymnasium and mujoco whose versions decide how its environment moves.
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

    def __post_init__(self) -> None:
        if self.paper_steps < 1:
            raise ValueError(f"task '{self.name}' has paper_steps {self.paper_steps}; it must be at least 1")


@dataclass(frozen=True)
class Suite:
    """A named list of tasks and the demonstrators that make their generated data.

    Attributes:
        name: what ``--suite`` takes.
        summary: one line for ``lfobench ls suites``.
        tasks: in table order.
        demonstrator: environment name and level to the policy, or the scripted demonstrator, that makes the data; None
            where nothing of it can be generated.
        generation_seeds: environment name to the seed of its generated data; 0 where not named.
        scene: environment name to what a top view of it shows; None where there is nothing to be seen from above.
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
