"""What the authors' loops share: their interface, and the pieces that each of them writes with torch.nn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from benchmarks.authors.host import Batch

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
    """Xavier-uniform weights and zero biases in every linear layer (methods.md 3.2)."""
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
    """Adam as it was when the authors' torch was new: parameter by parameter, operation by operation."""
    return torch.optim.Adam(parameters, learning_rate, weight_decay=weight_decay, foreach=False, fused=False)


def follow(target: nn.Module, online: nn.Module, rate: float) -> None:
    """Exponential moving average, parameter by parameter."""
    with torch.no_grad():
        for mean, parameter in zip(target.parameters(), online.parameters(), strict=True):
            mean.copy_((1.0 - rate) * mean + rate * parameter)
