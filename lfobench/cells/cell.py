"""Cells and runs, and the one identity that decides whether a run is already done."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, cast, get_args

from pydantic import ValidationError

from lfobench.cells.recipes import capped, recipe_identity, sizes
from lfobench.contract.method import DataNeeds, Method, MethodConfig, PresetName, budget_fields
from lfobench.contract.suite import Recipe, Task
from lfobench.errors import UserError, unknown_name
from lfobench.record import MOST_EPISODES, MOST_STEPS, NUMBERS, Labels, Tuning
from lfobench.text import content_hash


@dataclass(frozen=True)
class Assigned:
    """Numbers that a user puts in the place of a protocol's, and of a task's own budget under it; None puts none.

    Attributes:
        steps: gradient steps of a method's last stage.
        evaluation_every: steps between evaluations.
        evaluation_episodes: episodes of every evaluation.
        final_episodes: episodes from further starts, run once by the trained policy.
    """

    steps: int | None = None
    evaluation_every: int | None = None
    evaluation_episodes: int | None = None
    final_episodes: int | None = None

    def __post_init__(self) -> None:
        """Refuse what is no number of steps or episodes.

        Raises:
            UserError: naming the option, and the numbers that it takes.
        """
        for name, value in asdict(self).items():
            least = 0 if name == "final_episodes" else 1
            most = MOST_STEPS if name in ("steps", "evaluation_every") else MOST_EPISODES
            whole = isinstance(value, int) and not isinstance(value, bool)
            if value is not None and not (whole and least <= value <= most):
                raise UserError(
                    f"--{name.replace('_', '-')} {value!r} is no whole number from {least} to {most:,}.",
                    "Give one, or leave it to the protocol.",
                )


NOTHING_ASSIGNED = Assigned()


@dataclass(frozen=True)
class Protocol:
    """A training and evaluation budget.

    Attributes:
        name: what ``--protocol`` takes; records carry it.
        summary: one line for ``lfobench ls protocols``.
        steps: gradient steps of a method's last stage; None takes the task's own number from the paper.
        evaluation_every: steps between evaluations; the last step is always evaluated.
        evaluation_episodes: episodes of every evaluation.
        seeds: the default of ``--seeds``.
        offline_transitions: cap on the offline part; None keeps the recipe's.
        expert_trajectories: cap on K; None keeps the recipe's.
        assigned: what the user decided. Its steps stand beside `steps`, since an identity says so.
        further_episodes: from further starts, run once by the trained policy.
        methods_as: the protocol whose settings of the methods are taken; None takes this one's own.
    """

    name: str
    summary: str
    steps: int | None
    evaluation_every: int
    evaluation_episodes: int
    seeds: str
    offline_transitions: int | None = None
    expert_trajectories: int | None = None
    assigned: Assigned = NOTHING_ASSIGNED
    further_episodes: int = 0
    methods_as: str | None = None

    def for_task(self, task: Task) -> Protocol:
        """The protocol with a task's own budget, or its steps where the protocol has none, and the user's numbers."""
        budget, assigned = task.budgets.get(self.name), self.assigned
        own = self if budget is None else budget
        every, episodes, final = assigned.evaluation_every, assigned.evaluation_episodes, assigned.final_episodes
        return replace(
            self,
            steps=self._own_steps(task) if budget is None else budget.steps,
            evaluation_every=own.evaluation_every if every is None else every,
            evaluation_episodes=own.evaluation_episodes if episodes is None else episodes,
            further_episodes=own.further_episodes if final is None else final,
            methods_as=self.methods_as if budget is None else budget.methods,
        )

    def steps_for(self, task: Task) -> int:
        """Gradient steps of a method's last stage on `task`."""
        return self._own_steps(task) if self.assigned.steps is None else self.assigned.steps

    def _own_steps(self, task: Task) -> int:
        return task.paper_steps if self.steps is None else self.steps

    def recipe_for(self, task: Task) -> Recipe:
        """The task's recipe under this protocol's caps."""
        return capped(task.recipe, self.offline_transitions, self.expert_trajectories)

    def identity(self, task: Task) -> dict[str, Any]:
        """The fields that enter a run's identity."""
        return {
            "name": self.name,
            "steps": self.steps_for(task),
            "steps_assigned": self.steps_for(task) != self._own_steps(task),
            "evaluation_every": self.evaluation_every,
            "evaluation_episodes": self.evaluation_episodes,
            **({"further_episodes": self.further_episodes} if self.further_episodes else {}),
        }


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        Protocol(
            "paper",
            "the seed paper's steps, batches and 1M transitions; 10 episodes every 5000 steps; for a GPU",
            steps=None,
            evaluation_every=5_000,
            evaluation_episodes=10,
            seeds="0-6",
        ),
        Protocol(
            "quick",
            "12k steps of batch 256 on 200k offline transitions, with learning rates of its own; for a CPU",
            steps=12_000,
            evaluation_every=1_000,
            evaluation_episodes=5,
            seeds="0-2",
            offline_transitions=200_000,
        ),
        Protocol(
            "demo",
            "quick's learning rates on small networks, 5k steps, 40k + 40 trajectories: minutes for a first table",
            steps=5_000,
            evaluation_every=500,
            evaluation_episodes=3,
            seeds="0-2",
            offline_transitions=40_000,
            expert_trajectories=40,
        ),
        Protocol(
            "smoke",
            "a few steps of tiny networks on tiny data: shows that everything runs, and nothing else",
            steps=40,
            evaluation_every=10,
            evaluation_episodes=2,
            seeds="0-1",
            offline_transitions=2_000,
            expert_trajectories=2,
        ),
    )
}


def load_protocol(name: str) -> Protocol:
    """The protocol of that name.

    Raises:
        UserError: for an unknown name.
    """
    if name not in PROTOCOLS:
        raise unknown_name("protocol", name, [*PROTOCOLS, "auto"])
    return PROTOCOLS[name]


Precision = Literal["auto", "float32", "tf32", "bf16"]


def check_precision(name: str, device: str) -> Precision:
    """A precision that exists on the device.

    Raises:
        UserError: for an unknown name, or TF32 off CUDA.
    """
    if name not in get_args(Precision):
        raise unknown_name("precision", name, get_args(Precision))
    if name == "tf32" and device != "cuda":
        raise UserError("TF32 products exist on CUDA devices only.", "Use --precision auto, float32 or bf16.")
    return cast(Precision, name)


def effective(precision: Precision, device: str) -> Precision:
    """Precision that ``auto`` stands for: TF32 on CUDA, float32 elsewhere."""
    if precision != "auto":
        return precision
    return "tf32" if device == "cuda" else "float32"


Starts = Literal["evaluation", "validation"]


@dataclass(frozen=True)
class Cell:
    """method x preset x task x source x protocol.

    Attributes:
        method: the class.
        preset: name of the preset.
        config: what the preset, the protocol's budget and ``--set`` make of the method's defaults.
        budget: fields that the protocol or the task changed.
        assigned: fields that the user changed with ``--set``.
        suite: name or path of the suite, for finding it again in another process.
        suite_name: what the suite calls itself.
        task: with the suite's own recipe.
        protocol: the training and evaluation budget.
        source: where the data comes from.
        data: what identifies the data parts before they are read (level to part id).
        simulator: versions that decide the dynamics.
        precision: of matrix products, as asked for.
        tuned: fields whose values were chosen from the task's grid.
        tuning: how, and at what cost; None where nothing was chosen.
        code: files of a method that does not ship with lfobench, to their hashes.
        starts: which fixed starts policies are evaluated from: those of the tests, or others, to choose by.
    """

    method: type[Method]
    preset: PresetName
    config: MethodConfig
    budget: Mapping[str, Any]
    assigned: Mapping[str, Any]
    suite: str
    suite_name: str
    task: Task
    protocol: Protocol
    source: str
    data: Mapping[str, str]
    simulator: Mapping[str, str]
    precision: Precision
    tuned: Mapping[str, Any] = field(default_factory=dict)
    tuning: Tuning | None = None
    code: Mapping[str, str] = field(default_factory=dict)
    starts: Starts = "evaluation"

    @property
    def recipe(self) -> Recipe:
        """The recipe under the protocol's caps."""
        return self.protocol.recipe_for(self.task)

    @property
    def needs(self) -> DataNeeds:
        """Data that the method must see; on some tasks without the expert trajectories that others find in the mix."""
        needs: DataNeeds = self.method.needs(self.config)
        return replace(needs, expert_joins=False) if self._without_expert else needs

    @property
    def _without_expert(self) -> bool:
        return self.method.name in self.task.without_expert and self.recipe.expert_trajectories > 0

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Every field that decides the numbers, except the seed. Written down here and nowhere else."""
        environment = self.task.environment
        return {
            "schema": NUMBERS,
            "method": self.method.name,
            "method_version": self.method.version,
            "preset": self.preset,
            "config": self.config.identity(),
            "overrides": dict(self.budget),
            "set": dict(self.assigned),
            "task": self.task.name,
            "environment": {**asdict(environment), "arguments": dict(environment.arguments)},
            # Only where it is not [-1, 1], which older identities do not say.
            **({} if (box := environment.spaces.actions).is_unit else {"action_box": box.identity}),
            "recipe": recipe_identity(self.recipe),
            **({"expert_joins": False} if self._without_expert else {}),
            "source": self.source,
            "data": dict(self.data),
            "protocol": self.protocol.identity(self.task),
            "simulator": dict(self.simulator),
            "precision": self.precision,
            **({"method_code": dict(self.code)} if self.code else {}),
            **({"tuned": dict(self.tuned)} if self.tuned else {}),
            **({"starts": self.starts} if self.starts != "evaluation" else {}),
        }

    @property
    def labels(self) -> Labels:
        """Labels by which tables place this cell."""
        return Labels(
            suite=self.suite_name,
            group=self.task.group,
            row=self.task.environment.name,
            sees_expert_actions=self.method.access_to_expert_actions,
            stated=[field for field in self.method.stated if field not in self._decided_by_the_recipe],
            published_starts=self.task.published_starts,
            uncapped=sizes(self.task.recipe) if self.recipe != self.task.recipe else {},
        )

    @property
    def _decided_by_the_recipe(self) -> tuple[str, ...]:
        """Fields without effect: exact boundaries have no cross-episode transitions, whatever a method declares."""
        return ("termination",) if self.task.recipe.exact else ()

    @property
    def label(self) -> str:
        """Name in progress and messages: ``dilo:released hopper-random-expert``, and what was chosen, ``tau=3``."""
        tuned = "".join(f" {field}={value}" for field, value in self.tuned.items())
        return f"{self.method.name}:{self.preset} {self.task.name}{tuned}"


@dataclass(frozen=True)
class Run:
    """A cell and one seed, which leave one record."""

    cell: Cell
    seed: int

    @cached_property
    def identity(self) -> dict[str, Any]:
        """The cell's identity and the seed."""
        return {**self.cell.identity, "seed": self.seed}

    @cached_property
    def identity_hash(self) -> str:
        """SHA-256 of the identity; names the record."""
        return content_hash(self.identity)

    @property
    def label(self) -> str:
        """Name in progress and messages."""
        return f"{self.cell.label} seed {self.seed}"


@dataclass(frozen=True)
class Configuration:
    """A method's configuration and who changed what in it.

    Attributes:
        config: the result.
        budget: fields that the protocol or the task changed, as JSON values.
        assigned: fields that ``--set`` changed; one set to the value that it had anyway is not among them.
    """

    config: MethodConfig
    budget: dict[str, Any]
    assigned: dict[str, Any]


def configure(
    method: type[Method],
    preset: str,
    protocol: Protocol,
    assigned: Mapping[str, Any],
    settings: Mapping[str, Any] | None = None,
) -> Configuration:
    """The configuration of a method.

    Layers, later over earlier: the method's defaults, the preset, the protocol's budget, the task's `settings`,
    ``--set``.

    Raises:
        UserError: for an unknown preset or field, or a value of the wrong type or range.
    """
    if preset not in method.presets:
        raise unknown_name(f"preset of {method.name}", preset, method.presets)
    known = method.Config.model_fields
    for name in assigned:
        if name not in known:
            raise unknown_name(f"field of {method.name} in --set", name, known)
    declared = method.budgets.get(protocol.methods_as or protocol.name, {})
    budget = {**budget_fields(declared, protocol.assigned.steps or protocol.steps), **(settings or {})}
    for name, value in assigned.items():
        if isinstance(value, bool) and not isinstance(known[name].default, bool):
            raise UserError(
                f"--set {method.name}.{name}={value}: the field takes no truth value.",
                f"'lfobench show {method.name}' lists the fields with their types.",
            )
    plain = {**method.presets[preset], **budget}
    try:
        config = method.Config.model_validate({**plain, **assigned})
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise UserError(
            f"--set {method.name}.{place}={reprlib.repr(first['input'])}: {first['msg'].lower()}.",
            f"'lfobench show {method.name}' lists the fields with their types.",
        ) from error
    before = method.Config.model_validate(plain).model_dump(mode="json")
    after = config.model_dump(mode="json")
    changed = {name: after[name] for name in assigned if after[name] != before[name]}
    return Configuration(config, {name: after[name] for name in budget if name not in changed}, changed)
