"""The differentiable pass of a stack of perceptrons: one node of autograd's graph, its gradient written in place.

A file of its own, because its class derives from one of torch's: nothing else here needs torch before a network runs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch.autograd.function import once_differentiable

from lfobench.nn.perceptron import Layout, Parameters, batched, forward, join, multiply, product_type, signals_of

if TYPE_CHECKING:
    from torch import Tensor


class Pass(torch.autograd.Function):
    """Outputs ``[G, B, out]`` of inputs ``[S, B, in]``, once differentiable in the parameters ``[G, P]`` alone."""

    @staticmethod
    def forward(ctx: Any, leaf: Tensor, parameters: Parameters, inputs: Tensor) -> Tensor:
        """Keeps what every layer saw."""
        ctx.parameters, ctx.dtype, ctx.unit_signals = parameters, product_type(inputs.device), None
        ctx.version = parameters.flat._version
        ctx.seen, outputs = [], []
        entries = parameters.layout.shared(inputs.to(ctx.dtype))
        for layers, entry in zip(parameters.blocks(ctx.dtype), entries, strict=True):
            *hidden, output = forward(parameters.layout, layers, entry)
            ctx.seen.append([entry, *hidden])
            outputs.append(output)
        return join(outputs).float()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, signal: Tensor) -> tuple[Tensor, None, None]:
        """The gradient, written in place layer by layer."""
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
            ctx.unit_signals = [signals_of(layout, *each, None) for each in zip(blocks, ctx.seen, strict=True)]
        for entry, into in enumerate(layout.blocks(gradient)):
            if layout.sizes[-1] == 1:
                hidden = [unit * signals[entry] for unit in ctx.unit_signals[entry]]
            else:
                hidden = signals_of(layout, blocks[entry], ctx.seen[entry], signals[entry])
            for index, (weight, bias) in enumerate(into):
                if index < layout.frozen:
                    weight.zero_()
                    bias.zero_()
                    continue
                at_output = [*hidden, signals[entry]][index - layout.frozen]
                multiply(ctx.seen[entry][index].mT, at_output, weight)
                torch.sum(at_output, dim=-2, keepdim=True, dtype=torch.float32, out=bias)
        return gradient, None, None
