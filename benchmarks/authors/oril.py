"""ORIL's main stage as SMODICE's authors run it, the discriminator frozen."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.authors.loop import (
    HIDDEN,
    Batch,
    HostBuffer,
    HostData,
    Loop,
    Twins,
    adam,
    discriminator,
    follow,
    perceptron,
    reward,
)
from lfobench.contract.method import Shapes

DISCOUNT, LEARNING_RATE, TARGET_RATE = 0.99, 3e-4, 0.005
SMOOTHING_NOISE, SMOOTHING_LIMIT, VALUE_WEIGHT, POLICY_DELAY = 0.2, 0.5, 2.5, 2


class AuthorsOril(Loop):
    """ORIL as released, without its pre-training.

    Args:
        data: on the host.
        shapes: of observation, absorbing indicator included, and action.
        batch_size: offline rows.
        device: where the networks live.
        hidden: widths.

    Attributes:
        noise: standard normal numbers in the shape of its argument.
    """

    def __init__(
        self, data: HostData, shapes: Shapes, batch_size: int, device: torch.device, hidden: Sequence[int] = HIDDEN
    ) -> None:
        fields = ("observation", "action", "next_observation", "terminated")
        self._offline = HostBuffer(data.offline, fields, device, np.random.default_rng(0))
        self._batch_size = batch_size
        self._steps = 0
        self.noise: Callable[[Tensor], Tensor] = torch.randn_like
        self.discriminator = discriminator(shapes, hidden, device)
        self.actor = perceptron((shapes.observation, *hidden, shapes.action), output=nn.Tanh()).to(device)
        self.critic = Twins((shapes.observation + shapes.action, *hidden, 1)).to(device)
        self.actor_target = copy.deepcopy(self.actor).requires_grad_(False)
        self.critic_target = copy.deepcopy(self.critic).requires_grad_(False)
        self._actor_optimizer = adam(self.actor.parameters(), LEARNING_RATE)
        self._critic_optimizer = adam(self.critic.parameters(), LEARNING_RATE)

    def sample(self) -> tuple[Batch, Batch]:
        """Transitions."""
        return self._offline.sample(self._batch_size), {}

    def update(self, offline: Batch, expert: Batch) -> dict[str, float]:
        """Critics; every second step the actor and the targets too."""
        self._update_critic(offline)
        self._steps += 1
        if self._steps % POLICY_DELAY == 0:
            self._update_actor(offline)
            follow(self.actor_target, self.actor, TARGET_RATE)
            follow(self.critic_target, self.critic, TARGET_RATE)
        return {}

    def modules(self) -> dict[str, nn.Module]:
        """Actor, critics and their targets; the discriminator does not change."""
        return {
            "actor": self.actor,
            "critic": self.critic,
            "actor_target": self.actor_target,
            "critic_target": self.critic_target,
        }

    def _update_critic(self, offline: Batch) -> None:
        with torch.no_grad():
            noise = (SMOOTHING_NOISE * self.noise(offline["action"])).clamp(-SMOOTHING_LIMIT, SMOOTHING_LIMIT)
            next_action = (self.actor_target(offline["next_observation"]) + noise).clamp(-1.0, 1.0)
            next_value = self.critic_target.minimum(offline["next_observation"], next_action)
            target = reward(self.discriminator, offline["observation"])
            target = target + (1.0 - offline["terminated"]) * DISCOUNT * next_value
        first, second = self.critic.both(offline["observation"], offline["action"])
        loss = (first - target).square().mean() + (second - target).square().mean()
        self._critic_optimizer.zero_grad()
        loss.backward()
        self._critic_optimizer.step()

    def _update_actor(self, offline: Batch) -> None:
        """Back-propagation also fills the first critic's gradients, which the next critic step clears."""
        action = self.actor(offline["observation"])
        value = self.critic.first(torch.cat((offline["observation"], action), dim=-1)).squeeze(-1)
        scale = VALUE_WEIGHT / value.abs().mean().detach()
        loss = -scale * value.mean() + (action - offline["action"]).square().mean()
        self._actor_optimizer.zero_grad()
        loss.backward()
        self._actor_optimizer.step()
