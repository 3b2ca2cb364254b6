"""BCO: behavioural cloning from observation (Torabi, Warnell and Stone, IJCAI 2018), without interaction.

An inverse dynamics model h learns actions from offline data O and labels the expert's pairs E for a policy to clone:

    L_h = E_O[||h(s, s') - a||^2]                                     first stage
    L_pi = E_E[||pi(s) - h(s, s')||^2]                                second stage, h frozen

h and pi are deterministic networks with a tanh at the end, where the paper maximises likelihoods. No code of DILO's or
SMODICE's authors runs BCO; sizes, rates and the number of epochs are choices of this project, so both presets are the
same. Offline pairs use the true successor of every step, and the demonstration is the first expert episode (``exact``).
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
from methods import DEMO, SMOKE

if TYPE_CHECKING:
    from torch import Tensor

INVERSE_DYNAMICS = "inverse dynamics"

QUICK = {
    "batch_size": 256,
    "standardize": True,
    "inverse_dynamics_epochs": 2,
    "inverse_dynamics_learning_rate": 1e-3,
    "policy_learning_rate": 1e-3,
}


class BcoConfig(MethodConfig):
    """Hyperparameters of BCO."""

    later = frozenset({"standardize"})

    batch_size: int = Field(1024, ge=1, description="Rows per seed and step.")
    hidden: Widths = Field((256, 256), description="Hidden widths of both networks.")
    inverse_dynamics_epochs: int = Field(5, ge=1, description="Passes of the inverse dynamics model.")
    inverse_dynamics_batch_size: int | None = Field(
        None, ge=1, description="Rows per seed and step of those passes; none takes batch_size."
    )
    inverse_dynamics_learning_rate: float = Field(3e-4, gt=0, description="Its Adam step size.")
    policy_learning_rate: float = Field(1e-4, gt=0, description="Adam step size of the policy.")
    standardize: bool = Field(False, description="Shift and scale observations by the data's mean and std.")


class Bco(Method):
    """Inverse dynamics labels the demonstration, then behavioural cloning."""

    name = "bco"
    Config = BcoConfig
    config: BcoConfig
    stated = ("inverse_dynamics_epochs",)
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {"released": {}, "paper": {}}
    budgets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "quick": QUICK,
        "demo": {**QUICK, **DEMO},
        "smoke": {**SMOKE, "inverse_dynamics_epochs": 1},
    }

    @classmethod
    def needs(cls, config: BcoConfig) -> DataNeeds:
        """Offline pairs with actions; expert pairs without."""
        return DataNeeds(
            offline=("observation", "action", "next_observation"),
            expert=("observation", "next_observation"),
            boundary="exact",
            termination="zero",
            standardize=config.standardize,
        )

    def __init__(self, config: BcoConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        sizes = (2 * shapes.observation, *config.hidden, shapes.action)
        self.inverse_dynamics = Network(INVERSE_DYNAMICS, sizes, seeds, device)
        self.inverse_dynamics_optimizer = Adam(self.inverse_dynamics.flat, config.inverse_dynamics_learning_rate)
        self.policy = DeterministicPolicy(
            shapes, config.hidden, seeds, device, learning_rate=config.policy_learning_rate
        )

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """Inverse dynamics, `inverse_dynamics_epochs` times as many draws as there are offline pairs; then cloning."""
        batch = self.config.inverse_dynamics_batch_size or self.config.batch_size
        steps = self.config.inverse_dynamics_epochs * -(-sizes.offline // batch)
        return (
            Stage(INVERSE_DYNAMICS, steps, offline_batch=batch, expert_batch=0),
            Stage("policy", None, offline_batch=0, expert_batch=self.config.batch_size),
        )

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """A step of the inverse dynamics model, or of the policy on expert pairs that it labels."""
        if stage == INVERSE_DYNAMICS:
            loss = self.inverse_dynamics_loss(offline)
            self.inverse_dynamics_optimizer.step(self.inverse_dynamics.gradient(loss))
            return {"inverse_dynamics_loss": loss.detach()}
        with torch.no_grad():
            label = self.infer_action(expert)
        return self.policy.regress(expert["observation"], label)

    def infer_action(self, batch: Batch) -> Tensor:
        """``h(s, s') = tanh(MLP(s, s'))``, ``[S, B, act]``."""
        pair = torch.cat((batch["observation"], batch["next_observation"]), dim=-1)
        return torch.tanh(self.inverse_dynamics(pair))

    def inverse_dynamics_loss(self, offline: Batch) -> Tensor:
        """``L_h = E_O[||h(s, s') - a||^2]``, ``[S]``."""
        return squared_error(offline["action"], self.infer_action(offline)).mean(-1)

    def act(self, observation: Tensor) -> Tensor:
        """``pi(s)``."""
        return self.policy.act(observation)
