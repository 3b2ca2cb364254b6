"""Common parts of the authors' loops: their interface, and blocks in plain torch.nn."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lfobench.contract.method import Shapes

Array = NDArray[np.float32]
Columns = Mapping[str, Array]
Batch = dict[str, Tensor]


@dataclass(frozen=True)
class HostData:
    """A task's data as arrays of equally many rows per part.

    Attributes:
        offline: ``observation``, ``next_observation``, ``second_next_observation`` ``[N, obs]``, ``action``
            ``[N, act]``, ``reward``, ``terminated`` ``[N]``.
        initial: ``initial_observation`` ``[K, obs]``.
        expert: as `offline`.
    """

    offline: Columns
    initial: Columns
    expert: Columns


class HostBuffer:
    """Uniform draws with replacement.

    Args:
        columns: per field ``[N, ...]``.
        fields: those that a batch holds.
        device: where batches go.
        generator: draws the rows; buffers may share it.
    """

    def __init__(
        self, columns: Columns, fields: Sequence[str], device: torch.device, generator: np.random.Generator
    ) -> None:
        self._columns = {field: columns[field] for field in fields}
        self._rows = len(columns[fields[0]])
        self._device = device
        self._generator = generator

    def sample(self, count: int) -> Batch:
        """`count` rows of every field, ``[B, ...]`` on the device."""
        row = self._generator.integers(0, self._rows, count)
        return {field: torch.from_numpy(column[row]).to(self._device) for field, column in self._columns.items()}


HIDDEN = (256, 256)


class Loop(ABC):
    """One seed's training. A step is a sample from the host and an update; the two may be called apart."""

    @abstractmethod
    def sample(self) -> tuple[Batch, Batch]:
        """Offline and expert batch ``[B, ...]``; a part that the loop does not draw is empty."""

    @abstractmethod
    def update(self, offline: Batch, expert: Batch) -> dict[str, float]:
        """One gradient step; what the loop reads back from the device, by name."""

    @abstractmethod
    def modules(self) -> dict[str, nn.Module]:
        """The trained networks and their targets."""

    def step(self) -> dict[str, float]:
        """Sample, then update."""
        return self.update(*self.sample())


def perceptron(
    sizes: Sequence[int], *, activation: type[nn.Module] = nn.ReLU, output: nn.Module | None = None
) -> nn.Sequential:
    """Linear layers of these widths with an activation between them, and an optional one at the end."""
    layers: list[nn.Module] = []
    for fan_in, fan_out in pairwise(sizes):
        layers += [nn.Linear(fan_in, fan_out), activation()]
    layers[-1:] = [] if output is None else [output]
    return nn.Sequential(*layers)


def xavier(module: nn.Module) -> None:
    """Xavier-uniform weights and zero biases in every linear layer."""
    for layer in module.modules():
        if isinstance(layer, nn.Linear):
            nn.init.xavier_uniform_(layer.weight)
            nn.init.zeros_(layer.bias)


class Twins(nn.Module):
    """Two perceptrons with one output that see the same input, evaluated one after the other."""

    def __init__(self, sizes: Sequence[int]) -> None:
        super().__init__()
        self.first, self.second = perceptron(sizes), perceptron(sizes)

    def both(self, *inputs: Tensor) -> tuple[Tensor, Tensor]:
        """Outputs ``[B]`` of either at the concatenation of the inputs ``[B, ...]``."""
        joined = torch.cat(inputs, dim=-1)
        return self.first(joined).squeeze(-1), self.second(joined).squeeze(-1)

    def minimum(self, *inputs: Tensor) -> Tensor:
        """The smaller output, ``[B]``."""
        return torch.min(*self.both(*inputs))


def adam(parameters: Iterable[Tensor], learning_rate: float, weight_decay: float = 0.0) -> torch.optim.Adam:
    """Adam as in the torch of the authors' time: parameter by parameter, operation by operation."""
    return torch.optim.Adam(parameters, learning_rate, weight_decay=weight_decay, foreach=False, fused=False)


def follow(target: nn.Module, online: nn.Module, rate: float) -> None:
    """Exponential moving average, parameter by parameter."""
    with torch.no_grad():
        for mean, parameter in zip(target.parameters(), online.parameters(), strict=True):
            mean.copy_((1.0 - rate) * mean + rate * parameter)


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


def discriminator(shapes: Shapes, hidden: Sequence[int], device: torch.device) -> nn.Module:
    """D(s), as initialised: its weights do not affect the time of a main step."""
    network = perceptron((shapes.observation, *hidden, 1), activation=nn.Tanh)
    return network.to(device).requires_grad_(False)


def reward(network: nn.Module, observation: Tensor) -> Tensor:
    """``log sigma(D) - log(1 - sigma(D))``, ``[B]``; no gradient."""
    with torch.no_grad():
        probability = torch.sigmoid(network(observation).squeeze(-1))
        return torch.log(probability) - torch.log(1.0 - probability)
