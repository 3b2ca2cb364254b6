"""Implicit Q-learning (Kostrikov, Nair and Levine 2022), the offline learner below methods that label transitions.

With rewards r, Qbar the minimum over the target twins, and ``d = 1`` where s' is terminal:

    q   = Qbar(s, a),  u = q - V(s)
    L_V = E_O[|tau_e - 1[u <= 0]| u^2]                                    expectile regression
    L_pi = E_O[w error(a, pi(s))],  w = min(exp(B (q - V(s))), limit)     V after its step, q as above
    L_Q = sum_k E_O[(Q_k(s, a) - r - gamma (1 - d) V(s'))^2]              V after its step

in this order, one step of each per update, then the targets follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import torch
from pydantic import Field

from lfobench.contract.method import Batch, MethodConfig, Metrics, Shapes, Widths
from lfobench.nn.networks import Adam, Network
from lfobench.nn.policies import DeterministicPolicy, GaussianPolicy

if TYPE_CHECKING:
    from torch import Tensor


class IqlConfig(MethodConfig):
    """Hyperparameters of the learner, part of those of a method that has one."""

    batch_size: int = Field(256, ge=1, description="Offline rows per seed and step.")
    hidden: Widths = Field((256, 256), description="Hidden widths of every network.")
    discount: float = Field(0.99, ge=0, lt=1, description="gamma.")
    expectile: float = Field(0.7, gt=0, lt=1, description="tau_e of the value's expectile regression.")
    inverse_temperature: float = Field(3.0, ge=0, description="B of the policy weights exp(B (q - V)).")
    weight_limit: float = Field(100.0, gt=0, description="Upper bound of the policy weights.")
    policy: Literal["deterministic", "gaussian"] = Field(
        "deterministic", description="Policy class: mean squared error over rows and dimensions, or log-likelihood."
    )
    learning_rate: float = Field(3e-4, gt=0, description="Adam step size of every network.")
    policy_cosine_steps: int | None = Field(
        1_000_000, ge=1, description="Length of the policy's cosine schedule; none keeps the rate constant."
    )
    target_rate: float = Field(0.005, gt=0, le=1, description="EMA rate of the target critics.")
    standardize: bool = Field(False, description="Shift and scale observations by the data's mean and std.")


class Iql:
    """Value, twin critics with targets, and policy.

    Args:
        shapes: of observations and actions.
        seeds: the seed axis.
        device: where the parameters live.
        config: its hyperparameters.
    """

    def __init__(self, shapes: Shapes, seeds: Sequence[int], device: torch.device, config: IqlConfig) -> None:
        self._config = config
        self._actions = shapes.action
        self.value = Network("value", (shapes.observation, *config.hidden, 1), seeds, device)
        critic_sizes = (shapes.observation + shapes.action, *config.hidden, 1)
        self.critic = Network("critic", critic_sizes, seeds, device, heads=2)
        self.target = self.critic.copy()
        self._value_optimizer = Adam(self.value.flat, config.learning_rate)
        self._critic_optimizer = Adam(self.critic.flat, config.learning_rate)
        policy_class = DeterministicPolicy if config.policy == "deterministic" else GaussianPolicy
        self.policy = policy_class(
            shapes,
            config.hidden,
            seeds,
            device,
            learning_rate=config.learning_rate,
            cosine_steps=config.policy_cosine_steps,
        )

    def update(self, offline: Batch, reward: Tensor) -> Metrics:
        """One step of value, policy and critics on rows with rewards ``[S, B]``."""
        pairs = torch.cat((offline["observation"], offline["action"]), dim=-1)
        with torch.no_grad():
            q = self.target(pairs).squeeze(-1).amin(1)
        advantage = q - self.value(offline["observation"]).squeeze(-1)
        value_loss = self.expectile_loss(advantage)
        self._value_optimizer.step(self.value.gradient(value_loss))
        weight = self.policy_weights(q, offline["observation"])
        metrics = self.policy.regress(offline["observation"], offline["action"], self._per_row(weight))
        critic_loss = self.critic_loss(offline, pairs, reward)
        self._critic_optimizer.step(self.critic.gradient(critic_loss))
        self.target.follow(self.critic, self._config.target_rate)
        return metrics | {
            "value_loss": value_loss.detach(),
            "critic_loss": critic_loss.detach(),
            "target_value": q.mean(-1),
            "policy_weight": weight.mean(-1),
        }

    def expectile_loss(self, advantage: Tensor) -> Tensor:
        """``L_V`` of ``u = q - V(s)`` ``[S, B]``; ``[S]``."""
        tau = self._config.expectile
        weight = torch.where(advantage.detach() > 0, tau, 1.0 - tau)
        return (weight * advantage.square()).mean(-1)

    def policy_weights(self, q: Tensor, observation: Tensor) -> Tensor:
        """``w = min(exp(B (q - V(s))), limit)``, V after its step, ``[S, B]``; no gradient."""
        with torch.no_grad():
            advantage = q - self.value(observation).squeeze(-1)
            return torch.exp(self._config.inverse_temperature * advantage).clamp(max=self._config.weight_limit)

    def critic_loss(self, offline: Batch, pairs: Tensor, reward: Tensor) -> Tensor:
        """``L_Q`` of both critics, ``[S]``."""
        with torch.no_grad():
            following = self.value(offline["next_observation"]).squeeze(-1)
            target = reward + self._config.discount * (1.0 - offline["terminated"]) * following
        return (self.critic(pairs).squeeze(-1) - target[:, None]).square().mean(-1).sum(-1)

    def _per_row(self, weight: Tensor) -> Tensor:
        """Squared errors are means over dimensions here, where the policy sums them."""
        return weight / self._actions if self._config.policy == "deterministic" else weight
