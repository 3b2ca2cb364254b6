"""DILO: a dual approach to imitation learning from observations with offline datasets (CoRL 2024).

A value V(s, s') of consecutive observations solves the dual of matching the expert's visitation of (s', s'')
while staying on the offline data; the policy is then a regression on offline actions weighted by V.

Paper against released code (methods.md 4.1), chosen by preset:

=================  =================================  ==========================================
topic              ``paper``                          ``released``
=================  =================================  ==========================================
temperature tau    3                                  0.06
linear term        ``beta (1 - gamma) E[V]``, dual    ``(1 - lambda) mean V``, dual terms times
                   terms unscaled                     lambda = 0.8
policy             Gaussian log-likelihood, lr 3e-4   squared error of a deterministic policy,
                                                      lr 1e-4, cosine over 1e6 steps
=================  =================================  ==========================================

Twins, minimum over target twins, EMA 0.005 and the orthogonal projection are the code's; the paper is silent.
Terminal steps never reach the released loss: under ``teleport`` the successor of a terminal step is the first
observation of the next episode. ``absorbing`` is the sound alternative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import torch
from pydantic import Field
from torch import Tensor

from lfobench.contract.method import (
    Batch,
    DataNeeds,
    Method,
    MethodConfig,
    Metrics,
    Shapes,
    Sizes,
    Stage,
    Termination,
    Widths,
)
from lfobench.nn.networks import Adam, Network
from lfobench.nn.policies import DeterministicPolicy, GaussianPolicy
from lfobench.randomness import StepRandomness

# 12k steps of batch 256, what a CPU has time for. V has to climb towards 200 in them (methods.md 3.1, scale analysis),
# hence the larger rates; what they reach is in results/reference.
QUICK = {
    "batch_size": 256,
    "value_learning_rate": 2e-3,
    "policy_learning_rate": 1e-3,
    "target_rate": 0.02,
}


class DiloConfig(MethodConfig):
    """Hyperparameters of DILO."""

    batch_size: int = Field(1024, ge=1, description="Rows per seed and step from each of offline and expert.")
    hidden: Widths = Field((256, 256), description="Hidden widths of value and policy.")
    discount: float = Field(0.99, ge=0, lt=1, description="gamma.")
    conservatism: float | None = Field(
        0.8,
        ge=0,
        le=1,
        description="lambda of the released objective; none gives the paper's: linear term beta(1-gamma), "
        "dual terms unscaled.",
    )
    mixture: float = Field(0.5, gt=0, lt=1, description="beta, weight of expert pairs in the dual terms.")
    backward_weight: float = Field(0.5, ge=0, description="eta, weight of the backward loss.")
    tau: float = Field(0.06, ge=0, description="Temperature of the policy weights exp(tau V).")
    weight_limit: float = Field(100.0, gt=0, description="Upper bound of the policy weights.")
    policy: Literal["deterministic", "gaussian"] = Field(
        "deterministic", description="Policy class: squared error, or log-likelihood of a Gaussian."
    )
    value_learning_rate: float = Field(3e-4, gt=0, description="Adam step size of V.")
    policy_learning_rate: float = Field(1e-4, gt=0, description="Initial Adam step size of the policy.")
    policy_cosine_steps: int | None = Field(
        1_000_000, ge=1, description="Length of the policy's cosine schedule; none keeps the rate constant."
    )
    target_rate: float = Field(0.005, gt=0, le=1, description="EMA rate of the target value.")
    termination: Termination = Field(
        "teleport", description="What follows a terminal step: teleport (released), zero, absorbing."
    )


def conjugate(y: Tensor) -> Tensor:
    """``phi(y) = y w - (w - 1)^2``, ``w = max(0, y/2 + 1)``: Pearson chi^2 under w >= 0 (methods.md 3.1)."""
    weight = torch.clamp(y / 2.0 + 1.0, min=0.0)
    return y * weight - (weight - 1.0).square()


class Dilo(Method):
    """Dual imitation from observations: value of consecutive states, weighted regression."""

    name = "dilo"
    Config = DiloConfig
    config: DiloConfig
    stated = ("tau", "conservatism", "termination")
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "released": {},
        "paper": {
            "conservatism": None,
            "tau": 3.0,
            "policy": "gaussian",
            "policy_learning_rate": 3e-4,
            "policy_cosine_steps": None,
        },
    }
    budgets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "quick": QUICK,
        "demo": {**QUICK, "batch_size": 128, "hidden": (128, 128)},
        "smoke": {"batch_size": 32, "hidden": (32, 32)},
    }

    @classmethod
    def needs(cls, config: DiloConfig) -> DataNeeds:
        """Triples of observations; offline actions for the regression; no expert action."""
        return DataNeeds(
            offline=("observation", "action", "next_observation", "second_next_observation", "terminated"),
            expert=("observation", "next_observation", "second_next_observation", "terminated"),
            boundary="released" if config.termination == "teleport" else "exact",
            termination=config.termination,
        )

    def __init__(self, config: DiloConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        sizes = (2 * shapes.observation, *config.hidden, 1)
        self.value = Network("value", sizes, seeds, device, heads=2)
        self.target = self.value.copy()
        self.value_optimizer = Adam(self.value.flat, config.value_learning_rate)
        policy_class = DeterministicPolicy if config.policy == "deterministic" else GaussianPolicy
        self.policy = policy_class(
            shapes,
            config.hidden,
            seeds,
            device,
            learning_rate=config.policy_learning_rate,
            cosine_steps=config.policy_cosine_steps,
        )

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """One stage; offline row i is paired with expert row i, so both batches have one size."""
        batch = self.config.batch_size
        return (Stage("policy", None, offline_batch=batch, expert_batch=batch),)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """Value step, policy step on the new value, target update: the released order."""
        metrics = self.update_value(offline, expert)
        metrics |= self.update_policy(offline)
        self.target.follow(self.value, self.config.target_rate)
        return metrics

    def update_value(self, offline: Batch, expert: Batch) -> Metrics:
        """Adam step on ``grad L_0 + g_f + (g_b - kappa g_f)``."""
        rows = offline["observation"].shape[1]
        target = self._target_values(offline, expert)
        # Three graphs, because each loss term touches different passes: a joint graph would multiply zeros.
        value_offline = self.value(_pair(offline, "observation", "next_observation")).squeeze(-1)
        value_expert = self.value(_pair(expert, "observation", "next_observation")).squeeze(-1)
        successors = [_pair(batch, "next_observation", "second_next_observation") for batch in (offline, expert)]
        value_next = self.value(torch.cat(successors, dim=1)).squeeze(-1)

        discount = self.config.discount * (1.0 - torch.cat((offline["terminated"], expert["terminated"]), dim=1))
        forward_target = discount * target[:, 2 * rows :]
        forward = forward_target[:, None] - torch.cat((value_offline, value_expert), dim=-1)
        backward = discount[:, None] * value_next - target[:, None, : 2 * rows]

        linear_loss = self.linear_loss(value_offline)
        forward_loss = self.dual_loss(forward[..., :rows], forward[..., rows:])
        backward_loss = self.config.backward_weight * self.dual_loss(backward[..., :rows], backward[..., rows:])
        gradient = self.orthogonal_sum(
            self.value.gradient(linear_loss, retain_graph=True),
            self.value.gradient(forward_loss),
            self.value.gradient(backward_loss),
        )
        self.value_optimizer.step(gradient)
        return {
            "value_offline": value_offline.detach().mean((1, 2)),
            "value_expert": value_expert.detach().mean((1, 2)),
            "forward_loss": forward_loss.detach(),
            "backward_loss": backward_loss.detach(),
        }

    def _target_values(self, offline: Batch, expert: Batch) -> Tensor:
        """Minimum over target twins at offline (s, s'), expert (s, s'), offline (s', s''), expert (s', s'')."""
        pairs = [
            _pair(batch, first, second)
            for first, second in (
                ("observation", "next_observation"),
                ("next_observation", "second_next_observation"),
            )
            for batch in (offline, expert)
        ]
        with torch.no_grad():
            return self.target(torch.cat(pairs, dim=1)).squeeze(-1).amin(1)

    def dual_loss(self, offline_residual: Tensor, expert_residual: Tensor) -> Tensor:
        """``mean[beta phi(e^E) + (1 - beta)(phi(e^O) - e^O)]`` over rows and heads, times lambda; ``[S]``.

        L_f and, before the weight eta, L_b of methods.md 3.1.
        """
        beta, scale = self.config.mixture, self.config.conservatism
        offline = conjugate(offline_residual) - offline_residual
        loss = (beta * conjugate(expert_residual) + (1.0 - beta) * offline).mean((1, 2))
        return loss if scale is None else scale * loss

    def linear_loss(self, value_offline: Tensor) -> Tensor:
        """``(1 - lambda) mean V`` as released, or the paper's ``beta (1 - gamma) mean V`` without lambda."""
        config = self.config
        if config.conservatism is None:
            return config.mixture * (1.0 - config.discount) * value_offline.mean((1, 2))
        return (1.0 - config.conservatism) * value_offline.mean((1, 2))

    def orthogonal_sum(self, linear: Tensor, forward: Tensor, backward: Tensor) -> Tensor:
        """``g_0 + g_f + g_b - kappa g_f``: the backward gradient loses its part along the forward one.

        ``kappa = <g_f, g_b> / max(<g_f, g_f>, 1e-10)`` with both twins as one vector (ODICE's projection).
        """
        overlap = self.value.inner_product(forward, backward)
        kappa = overlap / self.value.inner_product(forward, forward).clamp(min=1e-10)
        return linear + forward + backward - kappa.repeat_interleave(self.value.heads)[:, None] * forward

    def policy_weights(self, offline: Batch) -> Tensor:
        """``min(exp(tau min_k V_k(s, s')), limit)`` with the updated online twins, ``[S, B]``; no gradient."""
        with torch.no_grad():
            value = self.value(_pair(offline, "observation", "next_observation")).squeeze(-1).amin(1)
            return torch.exp(self.config.tau * value).clamp(max=self.config.weight_limit)

    def update_policy(self, offline: Batch) -> Metrics:
        """Weighted regression on the offline actions."""
        weight = self.policy_weights(offline)
        loss = self.policy.regress(offline["observation"], offline["action"], weight)
        return {"policy_loss": loss, "policy_weight": weight.mean(-1)}

    def act(self, observation: Tensor) -> Tensor:
        """Deterministic actions."""
        with torch.no_grad():
            return self.policy.act(observation)


def _pair(batch: Batch, first: Any, second: Any) -> Tensor:
    """``[S, B, 2 obs]``, the input of V."""
    return torch.cat((batch[first], batch[second]), dim=-1)
