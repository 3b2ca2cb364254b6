"""State discriminator, whose logit is a reward.

    L_D = BCE(D(s_E), 1) + BCE(D(s_O), 0) + c mean (||grad_x D(x)|| - 1)^2          x = u s_E + (1 - u) s_O, u ~ U(0, 1)
    R(s) = log sigma(D(s)) - log(1 - sigma(D(s))) = D(s)

with expert states s_E, offline states s_O and the gradient penalty of Gulrajani et al. (2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from pydantic import Field

from lfobench.contract.method import MethodConfig, Metrics, Shapes, Sizes, Stage
from lfobench.nn.networks import Adam, Network
from lfobench.randomness import StepRandomness

if TYPE_CHECKING:
    from torch import Tensor


class DiscriminatorConfig(MethodConfig):
    """Hyperparameters of the discriminator, part of those of a method that has one."""

    discriminator_passes: int = Field(1000, ge=1, description="Passes over the expert states.")
    discriminator_batch: int = Field(256, ge=1, description="Expert states per discriminator step.")
    discriminator_learning_rate: float = Field(3e-4, gt=0, description="Adam step size of the discriminator.")
    gradient_penalty: float = Field(10.0, ge=0, description="Coefficient of the discriminator's penalty.")
    freeze_first_layer: bool = Field(
        True,
        description="Leave the discriminator's first layer at its initial values: the released optimiser is built "
        "over the later layers only, a slip that every published SMODICE and ORIL number contains.",
    )


class Discriminator:
    """D(s), trained to tell expert states from offline ones in a stage of its own, then frozen.

    Args:
        shapes: of the observation, absorbing indicator included.
        hidden: widths of the hidden layers.
        seeds: the seed axis.
        device: where the parameters live.
        config: its hyperparameters.
    """

    STAGE = "discriminator"

    def __init__(
        self,
        shapes: Shapes,
        hidden: Sequence[int],
        seeds: Sequence[int],
        device: torch.device,
        config: DiscriminatorConfig,
    ) -> None:
        self._config = config
        self._network = Network(
            self.STAGE,
            (shapes.observation, *hidden, 1),
            seeds,
            device,
            activation="tanh",
            frozen_layers=1 if config.freeze_first_layer else 0,
        )
        self._optimizer = Adam(self._network.flat, config.discriminator_learning_rate)

    def stage(self, sizes: Sizes) -> Stage:
        """Shuffled passes over the expert rows, each batch paired with as many offline rows.

        1000 expert rows in batches of 256 are 4 steps a pass: 4000 steps for 1000 passes.
        """
        batch = self._config.discriminator_batch
        steps = self._config.discriminator_passes * -(-sizes.expert // batch)
        return Stage(self.STAGE, steps, offline_batch=batch, expert_batch=batch, expert_epochs=True)

    def reward(self, observation: Tensor) -> Tensor:
        """``R(s) = D(s)``, the raw logit, ``[S, B]``; no gradient."""
        with torch.no_grad():
            return self._network(observation).squeeze(-1)

    def classification_loss(self, expert: Tensor, offline: Tensor) -> Tensor:
        """``BCE(D(s_E), 1) + BCE(D(s_O), 0)``, ``[S]``."""
        expert_logit, offline_logit = self._network(expert).squeeze(-1), self._network(offline).squeeze(-1)
        logsigmoid = torch.nn.functional.logsigmoid
        return -(logsigmoid(expert_logit).mean(-1) + logsigmoid(-offline_logit).mean(-1))

    def penalty_loss(self, expert: Tensor, offline: Tensor, fraction: Tensor) -> Tensor:
        """``mean (||grad_x D(x)|| - 1)^2`` at ``x = u s_E + (1 - u) s_O``, u = `fraction` ``[S, B, 1]``; ``[S]``."""
        mixed = (fraction * expert + (1.0 - fraction) * offline).requires_grad_()
        (slope,) = torch.autograd.grad(self._network(mixed).sum(), mixed, create_graph=True)
        norm: Tensor = torch.linalg.vector_norm(slope, dim=-1)
        return (norm - 1.0).square().mean(-1)

    def update(self, expert: Tensor, offline: Tensor, randomness: StepRandomness) -> Metrics:
        """One step on both losses; `offline` is cut to the expert rows of a short last batch."""
        offline = offline[:, : expert.shape[1]]
        fraction = randomness.uniform("gradient penalty", expert.shape[1], 1)
        classification = self.classification_loss(expert, offline)
        penalty = self.penalty_loss(expert, offline, fraction)
        loss = classification + self._config.gradient_penalty * penalty
        self._optimizer.step(self._network.gradient(loss))
        return {"discriminator_loss": classification.detach(), "gradient_penalty": penalty.detach()}
