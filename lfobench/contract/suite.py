"""What a suite declares: environments, data recipes and tasks. Plain data, no files, no printing."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from lfobench.contract.episodes import Episodes
from lfobench.contract.episodes import FloatArray as FloatArray
from lfobench.contract.scene import Scene

if TYPE_CHECKING:
    import gymnasium

Level = str
"""How well a part of the data was made, in the suite's own words: ``random``, ``medium``, ``expert``, …"""


class Demonstrator(Protocol):
    """A policy that makes a part of the generated data."""

    @property
    def fingerprint(self) -> str:
        """A hash of everything that decides the actions; two equal fingerprints act alike."""
        ...

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """An action ``[act]`` in [-1, 1] for one observation ``[obs]``, sampled with `generator`."""
        ...


@runtime_checkable
class Operator(Protocol):
    """Records whole episodes by itself, with starts, a pace and mistakes of its own."""

    @property
    def fingerprint(self) -> str:
        """A hash of everything that decides the episodes; two equal fingerprints record alike."""
        ...

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        """That many episodes. Where nothing was commanded (a hand-held object), their actions are NaN."""
        ...


@dataclass(frozen=True)
class Environment:
    """A simulator task and the two returns that define its normalised score.

    Attributes:
        name: the field's short name, e.g. ``hopper``.
        id: the Gymnasium id that is built, e.g. ``Hopper-v5``, with the module that registers it before a colon where
            Gymnasium does not know it by itself; every record names it.
        horizon: steps after which an episode is cut (truncated).
        random_return: return that scores 0.
        expert_return: return that scores 100.
        arguments: keyword arguments of ``gymnasium.make``.
    """

    name: str
    id: str
    horizon: int
    random_return: float
    expert_return: float
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.horizon < 1:
            raise ValueError(f"environment '{self.name}' has horizon {self.horizon}; it must be at least 1")
        if not (math.isfinite(self.random_return) and math.isfinite(self.expert_return)):
            raise ValueError(f"environment '{self.name}' has a reference return that is not finite")
        if self.random_return == self.expert_return:
            raise ValueError(f"environment '{self.name}' has two equal reference returns, so no score")
        try:
            json.dumps(dict(self.arguments), allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ValueError(f"environment '{self.name}' has arguments that are not plain JSON: {error}") from error

    def make(self) -> gymnasium.Env[Any, Any]:
        """A fresh environment, cut at `horizon`."""
        import gymnasium

        return gymnasium.make(self.id, max_episode_steps=self.horizon, **self.arguments)

    def make_many(self, count: int) -> gymnasium.vector.VectorEnv[Any, Any, Any] | None:
        """`count` environments that step together, each cut at `horizon`; None where the simulator has no such form."""
        import gymnasium

        module, _, name = self.id.rpartition(":")
        if module:
            importlib.import_module(module)  # which registers it, as `gymnasium.make` has it do
        if gymnasium.spec(name).vector_entry_point is None:
            return None
        return gymnasium.make_vec(
            name,
            num_envs=count,
            vectorization_mode=gymnasium.VectorizeMode.VECTOR_ENTRY_POINT,
            max_episode_steps=self.horizon,
            **self.arguments,
        )

    def normalized_score(self, episode_return: float) -> float:
        """Score ``100 (return - random) / (expert - random)`` (methods.md 5.1; D4RL's definition)."""
        return 100.0 * (episode_return - self.random_return) / (self.expert_return - self.random_return)


@dataclass(frozen=True)
class Recipe:
    """How a task's data is mixed (methods.md 2.3 and 2.4).

    Attributes:
        offline: level of the policy behind the poor part of the offline data.
        offline_transitions: raw transitions of that part.
        expert: level of the policy behind the expert part.
        expert_trajectories: K, trajectories of the expert part mixed into the offline data, with actions.
        demonstration_rows: rows of the expert part that form the one expert observation trajectory.
    """

    offline: Level
    offline_transitions: int
    expert: Level
    expert_trajectories: int
    demonstration_rows: int

    def __post_init__(self) -> None:
        for name, least in (("offline_transitions", 1), ("expert_trajectories", 0), ("demonstration_rows", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"a recipe's {name} is {getattr(self, name)}; it must be at least {least}")

    @property
    def words(self) -> tuple[str, str]:
        """The offline part, and what of the expert joins it."""
        offline = f"{self.offline_transitions:,} {self.offline} transitions"
        return offline, f"{self.expert_trajectories} {self.expert} trajectories"


@dataclass(frozen=True)
class TrajectoryRecipe:
    """Data counted in recorded trajectories; none of the expert part joins the offline part (methods.md 7).

    Every boundary is exact: the quirks of the D4RL readers belong to other data.

    Attributes:
        offline: level of the operator behind the offline data.
        offline_trajectories: recorded for that part.
        expert: level of the operator behind the demonstrations.
        expert_trajectories: recorded; all of them are observed.
        expert_transitions: where given, only this many (s, s', s'') of them are, drawn uniformly and in random order.
        expert_actions: whether the demonstrations have actions at all; a tracked hand has none.
        equal_transitions: cut the offline part to as many transitions as the recorded expert part has.
        standardize: shift and scale observations by the offline part's mean and standard deviation for every method,
            whatever it declares: in metres, a step is a hundredth of what networks are used to.
    """

    offline: Level
    offline_trajectories: int
    expert: Level
    expert_trajectories: int
    expert_transitions: int | None = None
    expert_actions: bool = True
    equal_transitions: bool = False
    standardize: bool = False

    def __post_init__(self) -> None:
        for name in ("offline_trajectories", "expert_trajectories", "expert_transitions"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"a recipe's {name} is {value}; it must be at least 1")

    @property
    def words(self) -> tuple[str, str]:
        """The offline part, and what of the expert is observed."""
        sample = "" if self.expert_transitions is None else f"{self.expert_transitions} transitions of "
        return (
            f"{self.offline_trajectories} {self.offline} trajectories",
            f"{sample}{self.expert_trajectories} {self.expert} trajectories",
        )


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
        grids: per method, the values of fields among which ``lfobench tune`` chooses.
    """

    name: str
    group: str
    environment: Environment
    recipe: Recipe | TrajectoryRecipe
    paper_steps: int
    budgets: Mapping[str, Budget] = field(default_factory=dict)
    settings: Settings = field(default_factory=dict)
    grids: Mapping[str, Mapping[str, tuple[Any, ...]]] = field(default_factory=dict)

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
        demonstrator: environment name and level to the policy, or the operator, that makes the data.
        generation_seeds: environment name to the seed of its generated data; 0 where not named.
        scene: environment name to what a top view of it shows; None where there is nothing to be seen from above.
    """

    name: str
    summary: str
    tasks: tuple[Task, ...]
    demonstrator: Callable[[str, Level], Demonstrator | Operator]
    generation_seeds: Mapping[str, int] = field(default_factory=dict)
    scene: Callable[[str], Scene] | None = None

    def __post_init__(self) -> None:
        names = [task.name for task in self.tasks]
        if not names:
            raise ValueError(f"suite '{self.name}' has no task")
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"suite '{self.name}' has two tasks named {', '.join(repeated)}")
