"""SMODICE: versatile offline imitation from observations by regularized state-occupancy matching (Ma et al. 2022).

A discriminator of states gives the reward, a value ``V(s)`` solves the dual of matching the expert's state occupancy
while staying on the offline data O, and the policy is weighted likelihood on the offline actions. With d = 1 where s'
is terminal and s_0 the starts of episodes:

    R(s) = log sigma(D(s)) - log(1 - sigma(D(s)))                     D trained first (lfobench.nn.discriminator)
    e = R(s) + gamma (1 - d) V(s') - V(s)                             residual, full gradient through both values

    KL:     L_V = (1 - gamma) E[V(s_0)] + log E_O[exp(e)],            w = exp(e)
    chi^2:  L_V = (1 - gamma) E[V(s_0)] + E_O[e^2 / 2 + e],           w = max(0, e + 1)

    L_pi = -E_O[w log pi(a|s)]                                        plus an entropy constraint, as released

V and pi are trained together, w from the value before its step.

Paper against released code, chosen by preset: the released optimiser of the discriminator leaves its first layer at the
random initial values (kept in ``released``, fixed in ``paper``), and the batch is 512 where DILO's paper states 1024
for every method.

Kept as released in both presets: the KL weights are not normalised; the chi^2 conjugate is the untruncated one although
its weight is truncated; absorbing rows are negatives of the discriminator and never drawn in the main stage, where
``1 - d`` masks a terminal row's successor anyway; the discriminator's offline rows are drawn with replacement, the
authors' from a shuffled pass, which makes no difference with a million rows.
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
from lfobench.nn.discriminator import Discriminator, DiscriminatorConfig
from lfobench.nn.networks import Adam, Network
from lfobench.nn.policies import TanhGaussianPolicy
from lfobench.randomness import StepRandomness
from methods import DEMO, SMOKE

if TYPE_CHECKING:
    from torch import Tensor

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
        "demo": {**QUICK, **DEMO, "discriminator_passes": 100},
        "smoke": {**SMOKE, "discriminator_passes": 2, "discriminator_batch": 128},
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
        if stage == self.discriminator.STAGE:
            return self.discriminator.update(expert["observation"], offline["observation"], randomness)
        residual = self.residual(offline)
        metrics = self.update_value(residual, offline)
        weight = self.policy_weights(residual.detach())
        metrics |= {"policy_weight": weight.mean(-1)}
        return metrics | self.policy.regress(offline["observation"], offline["action"], randomness, weight)

    def residual(self, offline: Batch) -> Tensor:
        """``e = R(s) + gamma (1 - d) V(s') - V(s)``, ``[S, B]``."""
        value = self.value(offline["observation"]).squeeze(-1)
        next_value = self.value(offline["next_observation"]).squeeze(-1)
        reward = self.discriminator.reward(offline["observation"])
        return reward + (1.0 - offline["terminated"]) * self.config.discount * next_value - value

    def update_value(self, residual: Tensor, offline: Batch) -> Metrics:
        """One step on ``L_V``."""
        initial = self.value(offline["initial_observation"]).squeeze(-1)
        loss = self.value_loss(residual, initial)
        self.value_optimizer.step(self.value.gradient(loss))
        return {"value_loss": loss.detach(), "value_initial": initial.detach().mean(-1)}

    def value_loss(self, residual: Tensor, initial: Tensor) -> Tensor:
        """``L_V = (1 - gamma) E[V(s_0)] + log E_O[exp(e)]`` (KL) or ``+ E_O[e^2/2 + e]`` (chi^2), ``[S]``."""
        linear = (1.0 - self.config.discount) * initial.mean(-1)
        if self.config.divergence == "kl":
            return linear + torch.logsumexp(residual, dim=-1) - math.log(residual.shape[-1])
        return linear + (residual.square() / 2.0 + residual).mean(-1)

    def policy_weights(self, residual: Tensor) -> Tensor:
        """``w = exp(e)`` (KL) or ``max(0, e + 1)`` (chi^2), neither normalised nor clipped, ``[S, B]``."""
        return torch.exp(residual) if self.config.divergence == "kl" else torch.clamp(residual + 1.0, min=0.0)

    def act(self, observation: Tensor) -> Tensor:
        """``tanh`` of the policy's mean."""
        return self.policy.act(observation)
