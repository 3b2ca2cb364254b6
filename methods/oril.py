"""ORIL as SMODICE's authors run it: a discriminator's reward, then TD3+BC (Fujimoto and Gu, NeurIPS 2021).

With offline data O, d = 1 where s' is terminal, twins Q_k, and bars for target networks:

    R(s) = log sigma(D(s)) - log(1 - sigma(D(s)))                     D trained first (lfobench.nn.discriminator)
    a' = clip(pibar(s') + clip(noise, -limit, limit), -1, 1)          target policy smoothing (TD3)
    y = R(s) + gamma (1 - d) min_k Qbar_k(s', a')

    L_Q = sum_k E_O[(Q_k(s, a) - y)^2]
    L_pi = -lambda E_O[Q_1(s, pi(s))] + E_O[(pi(s) - a)^2],           lambda = alpha / E_O|Q_1(s, pi(s))|

pi and the targets move at every second step of Q (``policy_delay``); lambda gets no gradient.

The original ORIL (Zolna et al. 2020) learns its reward by positive-unlabelled classification and the policy by CRR; the
numbers that SMODICE and DILO publish as ORIL's come from this simpler form. The presets differ as SMODICE's do: the
discriminator's frozen first layer and the batch size.
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
    Metrics,
    Shapes,
    Sizes,
    Stage,
    Widths,
)
from lfobench.nn.discriminator import Discriminator, DiscriminatorConfig
from lfobench.nn.networks import Adam, Network
from lfobench.randomness import StepRandomness
from methods import DEMO, SMOKE

if TYPE_CHECKING:
    from torch import Tensor

QUICK = {"batch_size": 256, "learning_rate": 1e-3, "target_rate": 0.02, "discriminator_passes": 250}


class OrilConfig(DiscriminatorConfig):
    """Hyperparameters of ORIL."""

    batch_size: int = Field(512, ge=1, description="Offline rows per seed and step.")
    hidden: Widths = Field((256, 256), description="Hidden widths of every network.")
    discount: float = Field(0.99, ge=0, lt=1, description="gamma.")
    learning_rate: float = Field(3e-4, gt=0, description="Adam step size of actor and critics.")
    target_rate: float = Field(0.005, gt=0, le=1, description="EMA rate of the targets.")
    smoothing_noise: float = Field(0.2, ge=0, description="Std of the target policy's smoothing noise.")
    smoothing_limit: float = Field(0.5, ge=0, description="Bound of that noise.")
    value_weight: float = Field(2.5, ge=0, description="alpha of TD3+BC: weight of the normalised Q term.")
    policy_delay: int = Field(2, ge=1, description="Critic steps per actor and target step.")
    absorbing: bool = Field(True, description="Send terminal steps to an absorbing state with its own indicator.")


class Oril(Method):
    """Discriminator reward, then TD3+BC on the offline data."""

    name = "oril"
    Config = OrilConfig
    config: OrilConfig
    stated = ("freeze_first_layer", "absorbing")
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
    def needs(cls, config: OrilConfig) -> DataNeeds:
        """Offline transitions; expert states only."""
        return DataNeeds(
            offline=("observation", "action", "next_observation", "terminated"),
            expert=("observation",),
            termination="absorbing" if config.absorbing else "teleport",
            standardize=True,
        )

    def __init__(self, config: OrilConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.discriminator = Discriminator(shapes, config.hidden, seeds, device, config)
        self.actor = Network("actor", (shapes.observation, *config.hidden, shapes.action), seeds, device)
        critic_sizes = (shapes.observation + shapes.action, *config.hidden, 1)
        self.critic = Network("critic", critic_sizes, seeds, device, heads=2)
        self.actor_target, self.critic_target = self.actor.copy(), self.critic.copy()
        self.actor_optimizer = Adam(self.actor.flat, config.learning_rate)
        self.critic_optimizer = Adam(self.critic.flat, config.learning_rate)

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """The discriminator first, then frozen."""
        return (
            self.discriminator.stage(sizes),
            Stage("policy", None, self.config.batch_size, expert_batch=0, period=self.config.policy_delay),
        )

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """A discriminator step, or a critic step and, every `policy_delay` steps, an actor step."""
        if stage == self.discriminator.STAGE:
            return self.discriminator.update(expert["observation"], offline["observation"], randomness)
        metrics = self.update_critic(offline, randomness)
        if randomness.phase == self.config.policy_delay - 1:
            self.update_actor(offline)
            self.actor_target.follow(self.actor, self.config.target_rate)
            self.critic_target.follow(self.critic, self.config.target_rate)
        return metrics

    def update_critic(self, offline: Batch, randomness: StepRandomness) -> Metrics:
        """One step of both critics."""
        target = self.critic_target_value(offline, randomness.normal("smoothing", *offline["action"].shape[1:]))
        loss = self.critic_loss(offline, target)
        self.critic_optimizer.step(self.critic.gradient(loss))
        return {"critic_loss": loss.detach(), "target_value": target.mean(-1)}

    def critic_target_value(self, offline: Batch, noise: Tensor) -> Tensor:
        """``y = R(s) + gamma (1 - d) min_k Qbar_k(s', a')``, a' smoothed by standard normal `noise`; ``[S, B]``."""
        limit = self.config.smoothing_limit
        smoothing = (self.config.smoothing_noise * noise).clamp(-limit, limit)
        with torch.no_grad():
            next_observation = offline["next_observation"]
            next_action = (torch.tanh(self.actor_target(next_observation)) + smoothing).clamp(-1.0, 1.0)
            next_value = self.critic_target(torch.cat((next_observation, next_action), dim=-1)).squeeze(-1).amin(1)
            bootstrap = (1.0 - offline["terminated"]) * self.config.discount * next_value
        return self.discriminator.reward(offline["observation"]) + bootstrap

    def critic_loss(self, offline: Batch, target: Tensor) -> Tensor:
        """``L_Q = sum_k E_O[(Q_k(s, a) - y)^2]``, ``[S]``."""
        value = self.critic(torch.cat((offline["observation"], offline["action"]), dim=-1)).squeeze(-1)
        return (value - target[:, None]).square().mean(-1).sum(-1)

    def update_actor(self, offline: Batch) -> None:
        """One step of the actor."""
        self.actor_optimizer.step(self.actor.gradient(self.actor_loss(offline)))

    def actor_loss(self, offline: Batch) -> Tensor:
        """``L_pi = -lambda E_O[Q_1(s, pi(s))] + E_O[(pi(s) - a)^2]``, the latter over dimensions, too; ``[S]``."""
        action = torch.tanh(self.actor(offline["observation"]))
        value = self.critic.head(0)(torch.cat((offline["observation"], action), dim=-1)).squeeze(-1)
        lambda_ = self.config.value_weight / value.detach().abs().mean(-1)
        return -lambda_ * value.mean(-1) + (action - offline["action"]).square().mean((1, 2))

    def act(self, observation: Tensor) -> Tensor:
        """``pi(s)``."""
        return torch.tanh(self.actor(observation))
