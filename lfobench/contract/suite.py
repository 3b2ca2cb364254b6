"""What a suite declares: environments, data recipes and tasks. Plain data, no files, no printing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from lfobench.contract.environment import Environment
from lfobench.contract.episodes import Episodes, FloatArray
from lfobench.contract.files import DataFile, Files, own_file
from lfobench.contract.recipe import Level, Recipe
from lfobench.contract.scene import Scene

__all__ = [
    "Budget",
    "DataFile",
    "Demonstrator",
    "Environment",
    "Files",
    "FloatArray",
    "Level",
    "Operator",
    "Recipe",
    "Settings",
    "Suite",
    "Task",
    "own_file",
]


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
class Operator(Protocol):
    """Records whole episodes by itself, with starts, a pace and mistakes of its own."""

    @property
    def fingerprint(self) -> str:
        """A hash of everything that decides the episodes; two equal fingerprints record alike."""
        ...

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        """That many episodes, in the environment's units.

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
        demonstrator: environment name and level to the policy, or the operator, that makes the data; None where
            nothing of it can be generated.
        generation_seeds: environment name to the seed of its generated data; 0 where not named.
        scene: environment name to what a top view of it shows; None where there is nothing to be seen from above.
    """

    name: str
    summary: str
    tasks: tuple[Task, ...]
    demonstrator: Callable[[str, Level], Demonstrator | Operator] | None
    generation_seeds: Mapping[str, int] = field(default_factory=dict)
    scene: Callable[[str], Scene] | None = None

    def __post_init__(self) -> None:
        names = [task.name for task in self.tasks]
        if not names:
            raise ValueError(f"suite '{self.name}' has no task")
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"suite '{self.name}' has two tasks named {', '.join(repeated)}")
