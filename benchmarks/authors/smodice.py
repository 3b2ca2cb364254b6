"""SMODICE's main stage, the discriminator frozen; KL, as released for locomotion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from benchmarks.authors.loop import (
    HIDDEN,
    LEARNING_RATE,
    Batch,
    HostBuffer,
    HostData,
    Loop,
    TanhGaussian,
    adam,
    discriminator,
    perceptron,
    reward,
    xavier,
)
from lfobench.contract.method import Shapes

DISCOUNT, VALUE_WEIGHT_DECAY = 0.99, 1e-4


class AuthorsSmodice(Loop):
    """SMODICE as released, without its pre-training.

    Args:
        data: on the host.
        shapes: of observation, absorbing indicator included, and action.
        batch_size: offline rows, and as many initial observations.
        device: where the networks live.
        hidden: widths.
    """

    def __init__(
        self, data: HostData, shapes: Shapes, batch_size: int, device: torch.device, hidden: Sequence[int] = HIDDEN
    ) -> None:
        generator = np.random.default_rng(0)
        fields = ("observation", "action", "next_observation", "terminated")
        self._offline = HostBuffer(data.offline, fields, device, generator)
        self._initial = HostBuffer(data.initial, ("initial_observation",), device, generator)
        self._batch_size = batch_size
        self.discriminator = discriminator(shapes, hidden, device)
        self.value = perceptron((shapes.observation, *hidden, 1)).to(device)
        xavier(self.value)
        self.policy = TanhGaussian(shapes, hidden, device)
        self._value_optimizer = adam(self.value.parameters(), LEARNING_RATE, VALUE_WEIGHT_DECAY)

    def sample(self) -> tuple[Batch, Batch]:
        """Transitions, and initial observations drawn apart from them."""
        return self._offline.sample(self._batch_size) | self._initial.sample(self._batch_size), {}

    def update(self, offline: Batch, expert: Batch) -> dict[str, float]:
        """Value, then policy, weighted by the value before its step."""
        observation = offline["observation"]
        value = self.value(observation).squeeze(-1)
        value_next = self.value(offline["next_observation"]).squeeze(-1)
        initial = self.value(offline["initial_observation"]).squeeze(-1)
        bootstrap = (1.0 - offline["terminated"]) * DISCOUNT * value_next
        residual = reward(self.discriminator, observation) + bootstrap - value
        loss = (1.0 - DISCOUNT) * initial.mean() + torch.logsumexp(residual, 0) - math.log(len(residual))
        self._value_optimizer.zero_grad()
        loss.backward()
        self._value_optimizer.step()
        self.policy.regress(observation, offline["action"], torch.exp(residual.detach()))
        return {}

    def modules(self) -> dict[str, nn.Module]:
        """Value and policy; the discriminator does not change."""
        return {"value": self.value, "policy": self.policy}
