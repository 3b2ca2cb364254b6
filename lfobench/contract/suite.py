"""What a suite declares: environments, data recipes and tasks. Plain data, no files, no printing."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import gymnasium

FloatArray = NDArray[np.float32]
Level = Literal["random", "medium", "expert"]


class Demonstrator(Protocol):
    """A policy that makes a part of the generated data."""

    @property
    def fingerprint(self) -> str:
        """A hash of everything that decides the actions; two equal fingerprints act alike."""
        ...

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """An action ``[act]`` in [-1, 1] for one observation ``[obs]``, sampled with `generator`."""
        ...


@dataclass(frozen=True)
class Environment:
    """A simulator task and the two returns that define its normalised score.

    Attributes:
        name: the field's short name, e.g. ``hopper``.
        id: the Gymnasium id that is built, e.g. ``Hopper-v5``; every record names it.
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


@dataclass(frozen=True)
class Task:
    """One row of a table: an environment and a data recipe.

    Attributes:
        name: e.g. ``hopper-random-expert``.
        group: the block of rows it belongs to in a table, e.g. ``random+expert``.
        environment: where policies are evaluated.
        recipe: what they are trained on.
        paper_steps: gradient steps that the seed paper gives this task.
    """

    name: str
    group: str
    environment: Environment
    recipe: Recipe
    paper_steps: int

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
        demonstrator: environment name and level to policy.
        generation_seeds: environment name to the seed of its generated data; 0 where not named.
    """

    name: str
    summary: str
    tasks: tuple[Task, ...]
    demonstrator: Callable[[str, Level], Demonstrator]
    generation_seeds: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = [task.name for task in self.tasks]
        if not names:
            raise ValueError(f"suite '{self.name}' has no task")
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"suite '{self.name}' has two tasks named {', '.join(repeated)}")
