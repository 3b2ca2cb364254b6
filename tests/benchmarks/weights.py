"""Weights carried between the engine's flat rows and the authors' modules."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode


def linears(module: nn.Module) -> list[nn.Linear]:
    """The linear layers in the order in which they were built."""
    return [layer for layer in module.modules() if isinstance(layer, nn.Linear)]


def unflatten(row: Tensor, sizes: Sequence[int]) -> list[Tensor]:
    """Weights ``[in, out]`` and biases of one row of the engine's parameters, without the padding."""
    parts, offset = [], 0
    for fan_in, fan_out in pairwise(sizes):
        for shape in ((fan_in, fan_out), (fan_out,)):
            parts.append(row[offset : offset + math.prod(shape)].view(shape))
            offset += math.prod(shape)
    return parts


def load(module: nn.Module, row: Tensor, sizes: Sequence[int]) -> None:
    """Give a perceptron the engine's parameters; two output layers share the last one side by side."""
    layers = linears(module)
    *shared, weight, bias = unflatten(row, sizes)
    parts = list(zip(shared[::2], shared[1::2], strict=True))
    outputs = len(layers) - len(parts)
    parts += list(zip(weight.chunk(outputs, 1), bias.chunk(outputs), strict=True))
    with torch.no_grad():
        for layer, (values, shifts) in zip(layers, parts, strict=True):
            layer.weight.copy_(values.T)
            layer.bias.copy_(shifts)


def flat(module: nn.Module) -> Tensor:
    """A perceptron's parameters as the engine lays them out, padding left away."""
    layers = linears(module)
    width = layers[0].out_features
    inner = [layer for layer in layers if layer.out_features == width]
    outputs = layers[len(inner) :]
    parts = [part for layer in inner for part in (layer.weight.T.flatten(), layer.bias)]
    parts.append(torch.cat([layer.weight.T for layer in outputs], dim=1).flatten())
    parts.append(torch.cat([layer.bias for layer in outputs]))
    return torch.cat(parts).detach()


class GivenNoise:
    """One seed's normal draws, chosen by the test."""

    def __init__(self, noise: Tensor | None = None, phase: int = 0) -> None:
        self.phase = phase
        self._noise = noise

    def normal(self, purpose: str, *shape: int) -> Tensor:
        assert self._noise is not None
        assert self._noise.shape == shape
        return self._noise[None]

    def uniform(self, purpose: str, *shape: int) -> Tensor:
        raise AssertionError("no update of a main stage draws uniform numbers")


class Calls(TorchDispatchMode):
    """Counts calls of torch's operations by name."""

    def __init__(self) -> None:
        super().__init__()
        self.counts: dict[str, int] = {}

    def __torch_dispatch__(
        self, func: Any, types: Any, args: Sequence[Any] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        name = str(func._overloadpacket)
        self.counts[name] = self.counts.get(name, 0) + 1
        return func(*args, **(kwargs or {}))


def counted(call: Callable[[], object]) -> dict[str, int]:
    """Operations of one call."""
    with Calls() as calls:
        call()
    return calls.counts
