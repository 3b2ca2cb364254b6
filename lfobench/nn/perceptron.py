"""Passes of a stack of multilayer perceptrons with a hand-written gradient: an inner part of `lfobench.nn.networks`.

Autograd over single operations would keep tensors that no loss needs and gather a gradient from pieces. Here a pass is
one node of autograd's graph: its products write where their results belong, and its gradient is one flat tensor, shaped
as the parameters. It rounds differently from plain autograd, so that dropping it would change published numbers.

Entries of the leading axis G (seeds x heads) run one after another on a CPU, where that costs nothing, keeps an entry's
hidden units in the cache and makes its bits independent of its neighbours; elsewhere they run as batched products.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import torch

if TYPE_CHECKING:
    from torch import Tensor

Activation = Literal["relu", "tanh"]
Layer: TypeAlias = "tuple[Tensor, Tensor]"
Place = tuple[tuple[int, int], int]

# Rows of a forward pass without gradient that go through all layers together, so that on a CPU their hidden units
# stay in the second-level cache.
ROWS_IN_CACHE = 256


@dataclass(frozen=True)
class Layout:
    """Places of the layers in flat parameters ``[G, P]``: weight ``[in, out]``, bias, the next layer's, padding.

    Attributes:
        sizes: widths from input to output.
        width: P.
        activation: between layers; the last layer is linear.
        heads: successive entries of G that see the same input.
        frozen: layers from the first that get no gradient.
    """

    sizes: tuple[int, ...]
    width: int
    activation: Activation
    heads: int = 1
    frozen: int = 0

    @cached_property
    def used(self) -> int:
        """Parameters of an entry, without the padding."""
        return sum((fan_in + 1) * fan_out for fan_in, fan_out in pairwise(self.sizes))

    def layers(self, flat: Tensor) -> list[Layer]:
        """Weights ``[G, in, out]`` and biases ``[G, 1, out]``, views of `flat`; differentiable."""
        lengths = [length for sizes in pairwise(self.sizes) for length in (sizes[0] * sizes[1], sizes[1])]
        *parts, _ = flat.split([*lengths, self.width - self.used], dim=1)
        return [
            (weight.unflatten(1, sizes), bias[:, None])
            for sizes, weight, bias in zip(pairwise(self.sizes), parts[::2], parts[1::2], strict=True)
        ]

    def blocks(self, flat: Tensor) -> list[list[Layer]]:
        """Layers that run together: those of every entry alone on a CPU, of all entries elsewhere."""
        if batched(flat):
            return [self.layers(flat)]
        return [
            [(_view(flat, *weight, start), _view(flat, *bias, start)) for weight, bias in self._places]
            for start in range(0, flat.numel(), self.width)
        ]

    @cached_property
    def _places(self) -> list[tuple[Place, Place]]:
        """Shape and offset of the weights and biases of an entry: a view from these is one operation."""
        places, offset = [], 0
        for fan_in, fan_out in pairwise(self.sizes):
            places.append((((fan_in, fan_out), offset), ((1, fan_out), offset + fan_in * fan_out)))
            offset += (fan_in + 1) * fan_out
        return places

    def shared(self, inputs: Tensor) -> Sequence[Tensor]:
        """The inputs ``[S, B, in]`` of every block, one after another."""
        if batched(inputs):
            return [inputs[:, None].expand(-1, self.heads, -1, -1).flatten(0, 1) if self.heads > 1 else inputs]
        return [entry for entry in inputs.unbind() for _ in range(self.heads)]


def product_type(device: torch.device) -> torch.dtype:
    """The number type of matrix products: float32, or autocast's inside it."""
    if torch.amp.is_autocast_available(device.type) and torch.is_autocast_enabled(device.type):
        return torch.get_autocast_dtype(device.type)
    return torch.float32


def batched(tensor: Tensor) -> bool:
    """Whether entries of the leading axis are multiplied as one product."""
    return tensor.device.type != "cpu"


class Parameters:
    """Flat parameters ``[G, P]``, changed in place by others, and their views.

    Attributes:
        flat: the parameters.
        leaf: an autograd leaf that shares their storage.
    """

    def __init__(self, layout: Layout, flat: Tensor) -> None:
        self.layout = layout
        self.flat = flat
        self.leaf = flat.detach().requires_grad_()
        self._blocks = layout.blocks(flat)

    def blocks(self, dtype: torch.dtype) -> list[list[Layer]]:
        """The layers that run together, as numbers of `dtype`."""
        return self._blocks if dtype == self.flat.dtype else self.layout.blocks(self.flat.to(dtype))


def composed(layout: Layout, flat: Tensor, inputs: Tensor) -> Tensor:
    """Outputs ``[G, B, out]`` of inputs ``[S, B, in]`` by torch's own operations: differentiable in both, and twice."""
    outputs = []
    entries = [flat] if batched(flat) else flat.split(1)
    for entry, hidden in zip(entries, layout.shared(inputs), strict=True):
        layers = layout.layers(entry)
        for index, (weight, bias) in enumerate(layers):
            frozen = index < layout.frozen
            hidden = torch.matmul(hidden, weight.detach() if frozen else weight)
            hidden = hidden + (bias.detach() if frozen else bias)
            if index < len(layers) - 1:
                hidden = torch.relu(hidden) if layout.activation == "relu" else torch.tanh(hidden)
        outputs.append(hidden.float())
    return torch.cat(outputs)


def evaluated(parameters: Parameters, inputs: Tensor) -> Tensor:
    """Outputs ``[G, B, out]`` of inputs ``[S, B, in]`` without gradient."""
    dtype = product_type(inputs.device)
    outputs = []
    with torch.no_grad():
        for layers, entry in zip(parameters.blocks(dtype), parameters.layout.shared(inputs.to(dtype)), strict=True):
            chunks = [entry] if batched(inputs) else entry.split(ROWS_IN_CACHE)
            outputs.append(torch.cat([_forward(parameters.layout, layers, chunk)[-1] for chunk in chunks], dim=-2))
        return _join(outputs).float()


def differentiable(parameters: Parameters, inputs: Tensor) -> Tensor:
    """Outputs ``[G, B, out]`` of inputs ``[S, B, in]``, once differentiable in the parameters alone."""
    outputs: Tensor = _node().apply(parameters.leaf, parameters, inputs)
    return outputs


@cache
def _node() -> Any:
    """The pass as a function of autograd; built at first use, because listing methods does without torch itself."""
    from torch.autograd.function import once_differentiable

    class Pass(torch.autograd.Function):
        forward = staticmethod(_outputs)
        backward = staticmethod(once_differentiable(_gradient))  # type: ignore[assignment]

    return Pass


def _outputs(ctx: Any, leaf: Tensor, parameters: Parameters, inputs: Tensor) -> Tensor:
    """Forward pass, which keeps the input of every layer."""
    ctx.parameters, ctx.dtype, ctx.unit_signals = parameters, product_type(inputs.device), None
    ctx.version = parameters.flat._version
    ctx.layer_inputs, outputs = [], []
    entries = parameters.layout.shared(inputs.to(ctx.dtype))
    for layers, entry in zip(parameters.blocks(ctx.dtype), entries, strict=True):
        *hidden, output = _forward(parameters.layout, layers, entry)
        ctx.layer_inputs.append([entry, *hidden])
        outputs.append(output)
    return _join(outputs).float()


def _gradient(ctx: Any, signal: Tensor) -> tuple[Tensor, None, None]:
    """Gradient, written in place layer by layer."""
    if ctx.parameters.flat._version != ctx.version:
        raise RuntimeError("the parameters changed between a pass and its gradient")
    layout: Layout = ctx.parameters.layout
    blocks = ctx.parameters.blocks(ctx.dtype)
    signal = signal.to(ctx.dtype)
    signals = [signal] if batched(signal) else signal.unbind()
    gradient = torch.empty_like(ctx.parameters.flat)
    gradient[:, layout.used :].zero_()
    if layout.sizes[-1] == 1 and ctx.unit_signals is None:
        # A row's signals are its output's, times signals that depend on the forward pass alone. Several losses of
        # one pass share those, and with them every product but the weights' gradients.
        ctx.unit_signals = [_signals(layout, *each, None) for each in zip(blocks, ctx.layer_inputs, strict=True)]
    for entry, into in enumerate(layout.blocks(gradient)):
        if layout.sizes[-1] == 1:
            hidden = [unit * signals[entry] for unit in ctx.unit_signals[entry]]
        else:
            hidden = _signals(layout, blocks[entry], ctx.layer_inputs[entry], signals[entry])
        for index, (weight, bias) in enumerate(into):
            if index < layout.frozen:
                weight.zero_()
                bias.zero_()
                continue
            at_output = [*hidden, signals[entry]][index - layout.frozen]
            _multiply(ctx.layer_inputs[entry][index].mT, at_output, weight)
            torch.sum(at_output, dim=-2, keepdim=True, dtype=torch.float32, out=bias)
    return gradient, None, None


def _view(flat: Tensor, shape: tuple[int, int], offset: int, start: int) -> Tensor:
    return flat.as_strided(shape, (shape[1], 1), start + offset)


def _join(outputs: Sequence[Tensor]) -> Tensor:
    """Outputs of all blocks as one tensor ``[G, B, out]``."""
    return outputs[0] if outputs[0].dim() == 3 else torch.stack(list(outputs))


def _forward(layout: Layout, layers: Sequence[Layer], inputs: Tensor) -> list[Tensor]:
    """Outputs of every layer, activation included, of inputs ``[..., B, in]``."""
    hidden, outputs = inputs, []
    for index, (weight, bias) in enumerate(layers):
        hidden = torch.matmul(hidden, weight).add_(bias)
        if index < len(layers) - 1:
            hidden = hidden.relu_() if layout.activation == "relu" else hidden.tanh_()
        outputs.append(hidden)
    return outputs


def _signals(
    layout: Layout, layers: Sequence[Layer], layer_inputs: Sequence[Tensor], output: Tensor | None
) -> list[Tensor]:
    """Signals ``[..., B, width]`` at the trained hidden layers, from the first; an `output` of None is all ones."""
    signals: list[Tensor] = []
    signal = output
    for index in range(len(layers) - 1, layout.frozen, -1):
        weight, hidden = layers[index][0], layer_inputs[index]
        arriving = weight.mT.expand_as(hidden) if signal is None else torch.matmul(signal, weight.mT)
        if layout.activation == "relu":
            signal = torch.ops.aten.threshold_backward(arriving, hidden, 0)
        else:
            signal = torch.ops.aten.tanh_backward(arriving, hidden)
        signals.insert(0, signal)
    return signals


def _multiply(left: Tensor, right: Tensor, out: Tensor) -> None:
    """Product written into `out`, whatever the number type of its factors."""
    if out.dtype == left.dtype:
        torch.matmul(left, right, out=out)
    else:
        out.copy_(torch.matmul(left, right))
