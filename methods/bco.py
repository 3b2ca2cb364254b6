"""BCO: behavioural cloning from observation (Torabi, Warnell, Stone, IJCAI 2018), offline.

An inverse dynamics model learns ``(s, s') -> a`` from offline data, labels the expert's pairs, and the labelled
pairs are cloned. No code of the seed paper's line releases it; sizes and rates are choices of ours, so
both presets are the same. Where 3.8 picks the epochs {1, 5, 10} by validation error, they are fixed here at 5.
Offline pairs use the true successor of every step, and the demonstration is the first expert episode (``exact``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from pydantic import Field

from lfobench.contract.method import (
    Batch,
    DataNeeds,
    Method,
    MethodConfig,
    Metrics,
    Shapes,
    Sizes,
    Stage,
    Widths,
)
from lfobench.nn.networks import Adam, Network
from lfobench.nn.policies import DeterministicPolicy, squared_error
from lfobench.randomness import StepRandomness

if TYPE_CHECKING:
    from torch import Tensor

INVERSE_DYNAMICS = "inverse dynamics"


# 12k steps of batch 256, what a CPU has time for, with rates raised as DILO's are. No claim that they suffice.
QUICK = {
    "batch_size": 256,
    "inverse_dynamics_epochs": 2,
    "inverse_dynamics_learning_rate": 1e-3,
    "policy_learning_rate": 1e-3,
}


class BcoConfig(MethodConfig):
    """Hyperparameters of BCO."""

    batch_size: int = Field(1024, ge=1, description="Rows per seed and step.")
    hidden: Widths = Field((256, 256), description="Hidden widths of both networks.")
    inverse_dynamics_epochs: int = Field(5, ge=1, description="Passes of the inverse dynamics model.")
    inverse_dynamics_batch_size: int | None = Field(
        None, ge=1, description="Rows per seed and step of those passes; none takes batch_size."
    )
    inverse_dynamics_learning_rate: float = Field(3e-4, gt=0, description="Its Adam step size.")
    policy_learning_rate: float = Field(1e-4, gt=0, description="Adam step size of the policy.")


class Bco(Method):
    """Inverse dynamics labels the demonstration, then behavioural cloning."""

    name = "bco"
    Config = BcoConfig
    config: BcoConfig
    stated = ("inverse_dynamics_epochs",)
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {"released": {}, "paper": {}}
    budgets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "quick": QUICK,
        "demo": {**QUICK, "batch_size": 128, "hidden": (128, 128)},
        "smoke": {"batch_size": 32, "hidden": (32, 32), "inverse_dynamics_epochs": 1},
    }

    @classmethod
    def needs(cls, config: BcoConfig) -> DataNeeds:
        """Offline pairs with actions; expert pairs without."""
        return DataNeeds(
            offline=("observation", "action", "next_observation"),
            expert=("observation", "next_observation"),
            boundary="exact",
            termination="zero",
        )

    def __init__(self, config: BcoConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        sizes = (2 * shapes.observation, *config.hidden, shapes.action)
        self.inverse_dynamics = Network(INVERSE_DYNAMICS, sizes, seeds, device)
        self.inverse_dynamics_optimizer = Adam(self.inverse_dynamics.flat, config.inverse_dynamics_learning_rate)
        self.policy = DeterministicPolicy(
            shapes, config.hidden, seeds, device, learning_rate=config.policy_learning_rate
        )

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """`inverse_dynamics_epochs` times as many draws as there are offline pairs, then cloning."""
        batch = self.config.inverse_dynamics_batch_size or self.config.batch_size
        steps = self.config.inverse_dynamics_epochs * -(-sizes.offline // batch)
        return (
            Stage(INVERSE_DYNAMICS, steps, offline_batch=batch, expert_batch=0),
            Stage("policy", None, offline_batch=0, expert_batch=self.config.batch_size),
        )

    def infer_action(self, batch: Batch) -> Tensor:
        """``h(s, s') = tanh(MLP(s, s'))``, ``[S, B, act]``."""
        pair = torch.cat((batch["observation"], batch["next_observation"]), dim=-1)
        return torch.tanh(self.inverse_dynamics(pair))

    def inverse_dynamics_loss(self, offline: Batch) -> Tensor:
        """``mean ||h(s, s') - a||^2``, ``[S]``."""
        return squared_error(offline["action"], self.infer_action(offline)).mean(-1)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """A step of the inverse dynamics model, or of the policy on expert pairs that it labels."""
        if stage == INVERSE_DYNAMICS:
            loss = self.inverse_dynamics_loss(offline)
            self.inverse_dynamics_optimizer.step(self.inverse_dynamics.gradient(loss))
            return {"inverse_dynamics_loss": loss.detach()}
        with torch.no_grad():
            label = self.infer_action(expert)
        return {"policy_loss": self.policy.regress(expert["observation"], label)}

    def act(self, observation: Tensor) -> Tensor:
        """Deterministic actions."""
        with torch.no_grad():
            return self.policy.act(observation)
