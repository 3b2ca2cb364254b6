"""DILO's loop: twenty critic passes, eleven copies to the device and twenty waits for it."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.authors.loop import HIDDEN, Batch, HostBuffer, HostData, Loop, Twins, adam, follow, perceptron
from lfobench.contract.method import Shapes

CONSERVATISM, MIXTURE, BACKWARD_WEIGHT, DISCOUNT = 0.8, 0.5, 0.5, 0.99
TAU, WEIGHT_LIMIT, TARGET_RATE, SQUARE_FLOOR = 0.06, 100.0, 0.005, 1e-10
VALUE_RATE, POLICY_RATE, COSINE_STEPS = 3e-4, 1e-4, 1_000_000

# Eleven copies, as counted in the released code. Five fields of either part make ten; the eleventh is taken to be the
# offline reward, which the loss ignores.
EXPERT_FIELDS = ("observation", "action", "next_observation", "second_next_observation", "terminated")
OFFLINE_FIELDS = (*EXPERT_FIELDS, "reward")


class AuthorsDilo(Loop):
    """DILO as released.

    Args:
        data: on the host.
        shapes: of observation and action.
        batch_size: rows from each of offline and expert.
        device: where the networks live.
        hidden: widths.
    """

    def __init__(
        self, data: HostData, shapes: Shapes, batch_size: int, device: torch.device, hidden: Sequence[int] = HIDDEN
    ) -> None:
        generator = np.random.default_rng(0)
        self._offline = HostBuffer(data.offline, OFFLINE_FIELDS, device, generator)
        self._expert = HostBuffer(data.expert, EXPERT_FIELDS, device, generator)
        self._batch_size = batch_size
        self.value = Twins((2 * shapes.observation, *hidden, 1)).to(device)
        self.target = copy.deepcopy(self.value).requires_grad_(False)
        self.policy = perceptron((shapes.observation, *hidden, shapes.action), output=nn.Tanh()).to(device)
        self._value_optimizer = adam(self.value.parameters(), VALUE_RATE)
        self._policy_optimizer = adam(self.policy.parameters(), POLICY_RATE)
        self._schedule = torch.optim.lr_scheduler.CosineAnnealingLR(self._policy_optimizer, COSINE_STEPS)

    def sample(self) -> tuple[Batch, Batch]:
        """Two independent draws."""
        return self._offline.sample(self._batch_size), self._expert.sample(self._batch_size)

    def update(self, offline: Batch, expert: Batch) -> dict[str, float]:
        """Value, policy, schedule, target: the released order."""
        metrics = self._update_value(offline, expert)
        metrics |= self._update_policy(offline)
        self._schedule.step()
        follow(self.target, self.value, TARGET_RATE)
        return metrics

    def modules(self) -> dict[str, nn.Module]:
        """Twins, their target, the policy."""
        return {"value": self.value, "target": self.target, "policy": self.policy}

    def _update_value(self, offline: Batch, expert: Batch) -> dict[str, float]:
        with torch.no_grad():
            target_offline, target_expert = (self.target.minimum(*_now(batch)) for batch in (offline, expert))
            target_offline_next, target_expert_next = (
                self.target.minimum(*_next(batch)) for batch in (offline, expert)
            )
        value_offline, value_offline_next = self.value.both(*_now(offline)), self.value.both(*_next(offline))
        value_expert, value_expert_next = self.value.both(*_now(expert)), self.value.both(*_next(expert))
        # The same pass once more: nothing uses it, and the released code makes it.
        self.value.both(*_next(expert))
        discount_offline = DISCOUNT * (1.0 - offline["terminated"])
        discount_expert = DISCOUNT * (1.0 - expert["terminated"])

        forward, backward = [], []
        for head in range(2):
            forward.append(
                _dual(
                    discount_offline * target_offline_next - value_offline[head],
                    discount_expert * target_expert_next - value_expert[head],
                )
            )
            backward.append(
                _dual(
                    discount_offline * value_offline_next[head] - target_offline,
                    discount_expert * value_expert_next[head] - target_expert,
                )
            )
        forward_loss = CONSERVATISM * (forward[0] + forward[1]) / 2.0
        backward_loss = CONSERVATISM * BACKWARD_WEIGHT * (backward[0] + backward[1]) / 2.0
        linear_loss = (1.0 - CONSERVATISM) * (value_offline[0].mean() + value_offline[1].mean()) / 2.0
        kappa = self._accumulate(linear_loss, forward_loss, backward_loss)
        self._value_optimizer.step()
        read = {
            "linear_loss": linear_loss,
            "forward_loss": forward_loss,
            "backward_loss": backward_loss,
            "kappa": kappa,
            **{f"forward_{head}": loss for head, loss in enumerate(forward)},
            **{f"backward_{head}": loss for head, loss in enumerate(backward)},
            "value_offline": value_offline[0].mean(),
            "value_expert": value_expert[0].mean(),
            "value_offline_next": value_offline_next[0].mean(),
            "value_expert_next": value_expert_next[0].mean(),
            "target_offline": target_offline.mean(),
            "target_expert": target_expert.mean(),
            "target_offline_next": target_offline_next.mean(),
            "target_expert_next": target_expert_next.mean(),
        }
        return {name: tensor.item() for name, tensor in read.items()}

    def _accumulate(self, linear_loss: Tensor, forward_loss: Tensor, backward_loss: Tensor) -> Tensor:
        """Leave ``g_0 + g_f + (g_b - kappa g_f)`` in the gradients; returns kappa."""
        forward = self._gradients(forward_loss)
        backward = self._gradients(backward_loss)
        linear = self._gradients(linear_loss)
        flat_forward = torch.cat([gradient.flatten() for gradient in forward])
        flat_backward = torch.cat([gradient.flatten() for gradient in backward])
        square = torch.dot(flat_forward, flat_forward)
        # Python looks at the tensor: one of the step's waits.
        if square < SQUARE_FLOOR:
            square = torch.full_like(square, SQUARE_FLOOR)
        kappa = torch.dot(flat_forward, flat_backward) / square
        parts = zip(self.value.parameters(), linear, forward, backward, strict=True)
        for parameter, of_linear, of_forward, of_backward in parts:
            parameter.grad = of_linear + of_forward + (of_backward - kappa * of_forward)
        return kappa

    def _gradients(self, loss: Tensor) -> list[Tensor]:
        self._value_optimizer.zero_grad()
        loss.backward(retain_graph=True)
        return [parameter.grad.clone() for parameter in self.value.parameters() if parameter.grad is not None]

    def _update_policy(self, offline: Batch) -> dict[str, float]:
        # The graph of these two passes is built and thrown away, as released.
        value = self.value.minimum(*_now(offline))
        weight = torch.exp(TAU * value).clamp(max=WEIGHT_LIMIT).detach()
        error = (offline["action"] - self.policy(offline["observation"])).square().sum(-1)
        loss = (weight * error).mean()
        self._policy_optimizer.zero_grad()
        loss.backward()
        self._policy_optimizer.step()
        read = {"policy_loss": loss, "policy_weight": weight.mean(), "advantage": value.mean()}
        return {name: tensor.item() for name, tensor in read.items()}


def _now(batch: Batch) -> tuple[Tensor, Tensor]:
    return batch["observation"], batch["next_observation"]


def _next(batch: Batch) -> tuple[Tensor, Tensor]:
    return batch["next_observation"], batch["second_next_observation"]


def _conjugate(y: Tensor) -> Tensor:
    """``phi(y) = y w - (w - 1)^2``, ``w = max(0, y/2 + 1)``."""
    weight = torch.clamp(y / 2.0 + 1.0, min=0.0)
    return y * weight - (weight - 1.0).square()


def _dual(offline: Tensor, expert: Tensor) -> Tensor:
    """``mean[beta phi(e^E) + (1 - beta)(phi(e^O) - e^O)]`` of one head's residuals ``[B]``."""
    return (MIXTURE * _conjugate(expert) + (1.0 - MIXTURE) * (_conjugate(offline) - offline)).mean()
