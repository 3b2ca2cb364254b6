"""Networks with a leading seed axis, and their optimiser.

All parameters of a network are one flat tensor ``[S*H, P]`` (S seeds, H heads, P padded with zeros); layers are
views of it. One program therefore evaluates every seed and head, and an optimiser step, a target update or an inner
product of gradients is one operation.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import torch

from lfobench.nn.perceptron import Activation, Layout, Parameters, composed, differentiable, evaluated
from lfobench.randomness import Randomness

if TYPE_CHECKING:
    from torch import Tensor

Initialization = Literal["torch", "xavier"]

# Vector kernels treat the last few elements of an array differently from the rest. A row of parameters that is a
# whole number of vectors long is never such a tail, so a seed gets the same bits alone and among others.
ROW_MULTIPLE = 64


def _initial_bounds(fan_in: int, fan_out: int, initialization: Initialization) -> tuple[float, float]:
    """Half-widths of the uniform initial weights and biases of a linear layer.

    ``torch`` is ``nn.Linear``'s default; ``xavier`` is Glorot and Bengio 2010, eq. 16, with zero biases.
    """
    if initialization == "torch":
        return 1.0 / math.sqrt(fan_in), 1.0 / math.sqrt(fan_in)
    return math.sqrt(6.0 / (fan_in + fan_out)), 0.0


class Network:
    """A multilayer perceptron per seed and head.

    Args:
        name: keys the initial weights, so that networks of one method differ.
        sizes: widths from input to output.
        seeds: one per entry of the seed axis.
        device: where the parameters live.
        heads: independent copies per seed that see the same input.
        activation: between layers; the last layer is linear.
        initialization: of the weights.
        merged_outputs: layers of equal width that the last one stands for; each has a layer's own initial
            bounds.
        frozen_layers: layers from the first that keep their initial values.
    """

    def __init__(
        self,
        name: str,
        sizes: Sequence[int],
        seeds: Sequence[int],
        device: torch.device,
        *,
        heads: int = 1,
        activation: Activation = "relu",
        initialization: Initialization = "torch",
        merged_outputs: int = 1,
        frozen_layers: int = 0,
    ) -> None:
        self.seed_count = len(seeds)
        self.heads = heads
        initial = [_initial_flat(seed, name, sizes, heads, initialization, merged_outputs) for seed in seeds]
        flat = torch.cat(initial).to(device)
        self._parameters = Parameters(Layout(tuple(sizes), flat.shape[1], activation, heads, frozen_layers), flat)

    @property
    def flat(self) -> Tensor:
        """``[S*H, P]``, the parameters; an optimiser and `follow` change them in place."""
        return self._parameters.flat

    def __call__(self, inputs: Tensor) -> Tensor:
        """Outputs ``[S, B, out]``, or ``[S, H, B, out]`` with several heads, of inputs ``[S, B, in]``.

        Inputs that need a gradient get one, and may be differentiated twice; others take the cheaper passes.
        """
        if not torch.is_grad_enabled():
            outputs = evaluated(self._parameters, inputs)
        elif inputs.requires_grad:
            outputs = composed(self._parameters.layout, self._parameters.leaf, inputs)
        else:
            outputs = differentiable(self._parameters, inputs)
        return outputs.unflatten(0, (self.seed_count, self.heads)) if self.heads > 1 else outputs

    def live_tensors(self) -> dict[str, Tensor]:
        """Tensors that training changes."""
        return {"": self.flat}

    def gradient(self, loss: Tensor, *, retain_graph: bool = False) -> Tensor:
        """Gradient ``[S*H, P]`` of a per-seed loss ``[S]``; zeros for frozen layers."""
        (gradient,) = torch.autograd.grad(loss.sum(), self._parameters.leaf, retain_graph=retain_graph)
        return gradient

    def inner_product(self, one: Tensor, other: Tensor) -> Tensor:
        """Inner product of two tensors shaped as the parameters, all heads of a seed as one vector: ``[S]``.

        Summed in pieces, each by one thread, so that the number of threads changes no bit.
        """
        return (one * other).view(self.seed_count, -1, ROW_MULTIPLE).sum(-1).sum(-1)

    def head(self, index: int) -> Callable[[Tensor], Tensor]:
        """The `index`-th head alone: ``[S, B, in] -> [S, B, out]``, differentiable in its input."""
        flat = self.flat.unflatten(0, (self.seed_count, self.heads))[:, index]
        alone = dataclasses.replace(self._parameters.layout, heads=1)
        return lambda inputs: composed(alone, flat, inputs)

    def copy(self) -> Network:
        """A network with the same parameters in storage of its own (a target network)."""
        twin = copy.copy(self)
        twin._parameters = Parameters(self._parameters.layout, self.flat.clone())
        return twin

    def follow(self, online: Network, rate: float) -> None:
        """Move the parameters towards `online` by `rate` (exponential moving average), in place."""
        self.flat.lerp_(online.flat, rate)


class SeedVector:
    """A trainable vector per seed, zero at first.

    Attributes:
        flat: ``[S, P]``, the values padded with zeros; what an optimiser changes.
        values: ``[S, width]``, an autograd leaf that shares its storage.
    """

    def __init__(self, width: int, seed_count: int, device: torch.device) -> None:
        self.flat = torch.zeros(seed_count, width + -width % ROW_MULTIPLE, device=device)
        self.values = self.flat[:, :width].detach().requires_grad_()

    def live_tensors(self) -> dict[str, Tensor]:
        """Tensors that training changes."""
        return {"": self.flat}

    def padded(self, gradient: Tensor) -> Tensor:
        """A gradient ``[S, width]`` in the shape of `flat`."""
        return torch.nn.functional.pad(gradient, (0, self.flat.shape[1] - gradient.shape[1]))


def _initial_flat(
    seed: int, name: str, sizes: Sequence[int], heads: int, initialization: Initialization, merged_outputs: int
) -> Tensor:
    """One seed's initial parameters ``[H, P]``: draws keyed by (seed, network, head)."""
    count = sum(fan_in * fan_out + fan_out for fan_in, fan_out in pairwise(sizes))
    randomness = Randomness([seed])
    rows = []
    for head in range(heads):
        signed = randomness.uniform(f"{name}: initial weights", head, count)[0] * 2.0 - 1.0
        parts = []
        for layer, (fan_in, fan_out) in enumerate(pairwise(sizes), start=2):
            drawn_as = fan_out // merged_outputs if layer == len(sizes) else fan_out
            weight_bound, bias_bound = _initial_bounds(fan_in, drawn_as, initialization)
            weight, bias, signed = signed.split([fan_in * fan_out, fan_out, len(signed) - fan_in * fan_out - fan_out])
            parts += [weight * weight_bound, bias * bias_bound]
        rows.append(torch.nn.functional.pad(torch.cat(parts), (0, -count % ROW_MULTIPLE)))
    return torch.stack(rows)


class Adam:
    """Adam (Kingma and Ba 2015) on one flat parameter tensor, optionally with a cosine learning rate.

    Args:
        parameters: changed in place.
        learning_rate: initial step size.
        weight_decay: L2 coefficient added to the gradient before the moments.
        cosine_steps: the rate is ``learning_rate * (1 + cos(pi * t / cosine_steps)) / 2`` at step t; None
            keeps it constant.
    """

    def __init__(
        self,
        parameters: Tensor,
        learning_rate: float,
        *,
        weight_decay: float = 0.0,
        cosine_steps: int | None = None,
    ) -> None:
        self._parameters = torch.nn.Parameter(parameters)
        self._learning_rate = torch.tensor(learning_rate, device=parameters.device)
        self._optimizer = torch.optim.Adam(
            [self._parameters],
            lr=learning_rate,
            weight_decay=weight_decay,
            fused=True,
            capturable=parameters.device.type != "cpu",
        )
        # A tensor, so that the schedule is part of a recorded step.
        self._optimizer.param_groups[0]["lr"] = self._learning_rate
        # torch.optim creates its state on the first step; a checkpoint needs the tensors from the start.
        self._state = {
            "step": torch.zeros((), device=parameters.device),
            "exp_avg": torch.zeros_like(parameters),
            "exp_avg_sq": torch.zeros_like(parameters),
        }
        self._optimizer.state[self._parameters] = self._state
        self._initial_rate = learning_rate
        self._cosine_steps = cosine_steps

    def step(self, gradient: Tensor) -> None:
        """Apply one gradient, shaped as the parameters."""
        if self._cosine_steps is not None:
            phase = (self._state["step"] * (math.pi / self._cosine_steps)).clamp(max=math.pi)
            self._learning_rate.copy_((torch.cos(phase) + 1.0) * (self._initial_rate / 2.0))
        self._parameters.grad = gradient
        self._optimizer.step()

    def live_tensors(self) -> dict[str, Tensor]:
        """Tensors that a step changes, except the parameters."""
        return self._state
