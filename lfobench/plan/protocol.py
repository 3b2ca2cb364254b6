"""Protocols: how long a run trains, on how much data, and how it is evaluated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from lfobench.contract.suite import Recipe, Task
from lfobench.errors import unknown_name


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
        assigned_steps: what ``--steps`` puts in the place of `steps`, if anything.
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
    assigned_steps: int | None = None
    further_episodes: int = 0
    methods_as: str | None = None

    def for_task(self, task: Task) -> Protocol:
        """What this protocol means for a task that has a budget of its own, and for any other task itself."""
        budget = task.budgets.get(self.name)
        if budget is None:
            return self
        return replace(
            self,
            steps=budget.steps,
            evaluation_every=budget.evaluation_every,
            evaluation_episodes=budget.evaluation_episodes,
            further_episodes=budget.further_episodes,
            methods_as=budget.methods,
        )

    def steps_for(self, task: Task) -> int:
        """Gradient steps of a method's last stage on `task`."""
        return self._own_steps(task) if self.assigned_steps is None else self.assigned_steps

    def _own_steps(self, task: Task) -> int:
        return task.paper_steps if self.steps is None else self.steps

    def recipe_for(self, task: Task) -> Recipe:
        """The task's recipe under this protocol's caps."""
        return task.recipe.capped(self.offline_transitions, self.expert_trajectories)

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
