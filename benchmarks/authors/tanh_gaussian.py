"""The squashed Gaussian that SMODICE's script trains, for its own method and for BC (methods.md 3.2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from benchmarks.authors.loop import adam, perceptron, xavier
from lfobench.contract.method import Shapes

LEARNING_RATE = 3e-4
MEAN_LIMIT, LOG_STD_RANGE, ACTION_MARGIN = 7.24, (-5.0, 2.0), 1e-6


class TanhGaussian(nn.Module):
    """A trunk with a mean and a log-std head, and the multiplier of its entropy constraint.

    Attributes:
        noise: standard normal numbers in the shape of its argument.
    """

    def __init__(self, shapes: Shapes, hidden: Sequence[int], device: torch.device) -> None:
        super().__init__()
        self.trunk = perceptron((shapes.observation, *hidden), output=nn.ReLU())
        self.mean, self.log_std = nn.Linear(hidden[-1], shapes.action), nn.Linear(hidden[-1], shapes.action)
        xavier(self)
        self.to(device)
        self.log_temperature = torch.zeros((), device=device, requires_grad=True)
        self.noise: Callable[[Tensor], Tensor] = torch.randn_like
        self._target_entropy = -float(shapes.action)
        self._optimizer = adam(self.parameters(), LEARNING_RATE)
        self._temperature_optimizer = adam([self.log_temperature], LEARNING_RATE)

    def regress(self, observation: Tensor, action: Tensor, weight: Tensor | None = None) -> None:
        """One step of ``-mean(w log pi(a|s)) + exp(l) mean log pi(a~|s)``, and one of the multiplier l."""
        hidden = self.trunk(observation)
        mean = self.mean(hidden).clamp(-MEAN_LIMIT, MEAN_LIMIT)
        log_std = self.log_std(hidden).clamp(*LOG_STD_RANGE)
        inside = action.clamp(-1.0 + ACTION_MARGIN, 1.0 - ACTION_MARGIN)
        log_likelihood = _log_density(torch.atanh(inside), inside, mean, log_std)
        sample = mean + log_std.exp() * self.noise(mean)
        log_sample = _log_density(sample, torch.tanh(sample), mean, log_std)
        fit = log_likelihood if weight is None else weight * log_likelihood
        loss = -fit.mean() + self.log_temperature.detach().exp() * log_sample.mean()
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        temperature_loss = -(self.log_temperature * (log_sample.detach() + self._target_entropy)).mean()
        self._temperature_optimizer.zero_grad()
        temperature_loss.backward()
        self._temperature_optimizer.step()


def _log_density(pre_tanh: Tensor, action: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """``log pi(a|s)`` of squashed actions ``[B, act]``, ``[B]``."""
    normal = -0.5 * ((pre_tanh - mean) / log_std.exp()).square() - log_std - 0.5 * math.log(2.0 * math.pi)
    return (normal - torch.log(1.0 - action.square() + ACTION_MARGIN)).sum(-1)
