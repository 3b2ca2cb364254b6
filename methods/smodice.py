"""SMODICE: versatile offline imitation from observations via state-occupancy matching (ICML 2022).

A discriminator of states gives the reward; a value V(s) solves the dual of matching the expert's state
occupancy; the policy is weighted likelihood on offline actions.

Paper against released code, chosen by preset: the released optimiser of the discriminator
leaves its first layer at the random initial values (kept in ``released``, mended in ``paper``), and the batch is
512 where the seed paper states 1024 for every method.

Kept as released in both presets: the KL weights are ``exp(e)``, not normalised; the chi^2 conjugate is the
untruncated one although its weight is truncated; absorbing rows are negatives of the discriminator and never drawn
in the main stage, where ``1 - d`` masks a terminal row's successor anyway; the discriminator's offline rows are
drawn with replacement, the authors' from a shuffled pass, which a million rows do not notice.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import torch
from pydantic import Field

from lfobench.contract.method import (
    Batch,
    DataNeeds,
    Method,
    Metrics,
    Shapes,
    Sizes,
    Stage,
    Widths,
)
from lfobench.nn import discriminator
from lfobench.nn.discriminator import Discriminator, DiscriminatorConfig
from lfobench.nn.networks import Adam, Network
from lfobench.nn.policies import TanhGaussianPolicy
from lfobench.randomness import StepRandomness

if TYPE_CHECKING:
    from torch import Tensor

# 12k steps of batch 256, what a CPU has time for, with rates raised as DILO's are. No claim that they suffice.
QUICK = {"batch_size": 256, "learning_rate": 1e-3, "discriminator_passes": 250}


class SmodiceConfig(DiscriminatorConfig):
    """Hyperparameters of SMODICE."""

    batch_size: int = Field(512, ge=1, description="Offline rows per seed and step.")
    hidden: Widths = Field((256, 256), description="Hidden widths of every network.")
    discount: float = Field(0.99, ge=0, lt=1, description="gamma.")
    divergence: Literal["kl", "chi2"] = Field("kl", description="f: KL for locomotion, chi^2 for kitchen.")
    learning_rate: float = Field(3e-4, gt=0, description="Adam step size of value, policy and temperature.")
    value_weight_decay: float = Field(1e-4, ge=0, description="L2 coefficient inside the value's Adam.")
    entropy_constraint: bool = Field(True, description="Keep the policy's entropy near -dim(action).")
    absorbing: bool = Field(True, description="Send terminal steps to an absorbing state with its own indicator.")


class Smodice(Method):
    """State-occupancy matching: discriminator reward, DICE value, weighted likelihood."""

    name = "smodice"
    Config = SmodiceConfig
    config: SmodiceConfig
    stated = ("divergence", "freeze_first_layer", "absorbing")
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "released": {},
        "paper": {"freeze_first_layer": False, "batch_size": 1024},
    }
    budgets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "quick": QUICK,
        "demo": {**QUICK, "batch_size": 128, "hidden": (128, 128), "discriminator_passes": 100},
        "smoke": {
            "batch_size": 32,
            "hidden": (32, 32),
            "discriminator_passes": 2,
            "discriminator_batch": 128,
        },
    }

    @classmethod
    def needs(cls, config: SmodiceConfig) -> DataNeeds:
        """Offline transitions and start states; expert states only."""
        return DataNeeds(
            offline=("observation", "action", "next_observation", "terminated", "initial_observation"),
            expert=("observation",),
            termination="absorbing" if config.absorbing else "teleport",
            standardize=True,
        )

    def __init__(self, config: SmodiceConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.discriminator = Discriminator(shapes, config.hidden, seeds, device, config)
        self.value = Network("value", (shapes.observation, *config.hidden, 1), seeds, device, initialization="xavier")
        self.value_optimizer = Adam(self.value.flat, config.learning_rate, weight_decay=config.value_weight_decay)
        self.policy = TanhGaussianPolicy(
            shapes,
            config.hidden,
            seeds,
            device,
            learning_rate=config.learning_rate,
            entropy_constraint=config.entropy_constraint,
        )

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """The discriminator first, then frozen."""
        return (
            self.discriminator.stage(sizes),
            Stage("policy", None, offline_batch=self.config.batch_size, expert_batch=0),
        )

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """A discriminator step, or a value step and a policy step weighted by the value before it."""
        if stage == discriminator.STAGE:
            return self.discriminator.update(expert["observation"], offline["observation"], randomness)
        metrics, weight = self.update_value(offline)
        return metrics | self.policy.regress(offline["observation"], offline["action"], weight, randomness)

    def update_value(self, offline: Batch) -> tuple[Metrics, Tensor]:
        """One step on L_V; returns metrics and the policy weights, both from the value before the step."""
        residual = self.residual(offline)
        initial = self.value(offline["initial_observation"]).squeeze(-1)
        loss = self.value_loss(residual, initial)
        weight = self.policy_weights(residual.detach())
        self.value_optimizer.step(self.value.gradient(loss))
        metrics = {"value_loss": loss.detach(), "value_initial": initial.detach().mean(-1)}
        return metrics | {"policy_weight": weight.mean(-1)}, weight

    def residual(self, offline: Batch) -> Tensor:
        """``e = R(s) + (1 - d) gamma V(s') - V(s)``, ``[S, B]``; full gradient through both values."""
        value = self.value(offline["observation"]).squeeze(-1)
        value_next = self.value(offline["next_observation"]).squeeze(-1)
        reward = self.discriminator.reward(offline["observation"])
        return reward + (1.0 - offline["terminated"]) * self.config.discount * value_next - value

    def value_loss(self, residual: Tensor, initial: Tensor) -> Tensor:
        """``(1 - gamma) mean V(s_0)`` plus ``log mean exp(e)`` (KL) or ``mean(e^2/2 + e)`` (chi^2); ``[S]``.

        The chi^2 conjugate is the untruncated one although its weight below is truncated, as released.
        """
        linear = (1.0 - self.config.discount) * initial.mean(-1)
        if self.config.divergence == "kl":
            return linear + torch.logsumexp(residual, dim=-1) - math.log(residual.shape[-1])
        return linear + (residual.square() / 2.0 + residual).mean(-1)

    def policy_weights(self, residual: Tensor) -> Tensor:
        """``exp(e)`` (KL) or ``max(0, e + 1)`` (chi^2), neither normalised nor clipped, as released."""
        return torch.exp(residual) if self.config.divergence == "kl" else torch.clamp(residual + 1.0, min=0.0)

    def act(self, observation: Tensor) -> Tensor:
        """Mean actions."""
        with torch.no_grad():
            return self.policy.act(observation)
