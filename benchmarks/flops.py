"""The matrix products of one step of each method, counted from its formulas.

A multiplication and its addition are two operations (FLOP). Only products count: activations, losses, optimisers and
target updates are linear in what a product is quadratic in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor

from lfobench.contract.method import Shapes
from lfobench.engine.program import recorder_for
from lfobench.nn.perceptron import ROWS_IN_CACHE

Kind = Literal["forward", "weight gradient", "signal"]
Account = Literal["released", "needed", "shared"]


@dataclass(frozen=True)
class Pass:
    """One perceptron on some rows.

    Attributes:
        name: what it is for.
        sizes: widths from input to output.
        rows: B, or a multiple where the formulas let passes of one network run together.
        heads: networks that see these rows.
        forward: evaluations per step.
        backward: gradients of the weights per step.
        signals: passes of the loss's gradient through the hidden layers; None stands for `backward`.
        input_columns: input columns that need a gradient, once per pass of signals.
        every: steps between two of these passes.
    """

    name: str
    sizes: tuple[int, ...]
    rows: int
    heads: int = 1
    forward: int = 1
    backward: int = 0
    signals: int | None = None
    input_columns: int = 0
    every: int = 1

    @property
    def signal_passes(self) -> int:
        """`signals`, its default filled in."""
        return self.backward if self.signals is None else self.signals


@dataclass(frozen=True)
class Product:
    """An ``[m, k] @ [k, n]``: ``X W`` forward, ``X^T G`` for a weight gradient, ``G W^T`` for a signal.

    Attributes:
        kind: which of the three, hence what is transposed.
        m: rows of the result.
        k: length of the sums.
        n: columns of the result.
        count: how often per step, on average.
    """

    kind: Kind
    m: int
    k: int
    n: int
    count: Fraction

    @property
    def flops(self) -> Fraction:
        """Operations per step."""
        return 2 * self.m * self.k * self.n * self.count


def products(passes: Sequence[Pass]) -> list[Product]:
    """Every distinct product of these passes and its count per step, the costliest first."""
    shares: dict[tuple[Kind, int, int, int], Fraction] = {}
    for one in passes:
        for layer, (fan_in, fan_out) in enumerate(pairwise(one.sizes)):
            back_to = fan_in if layer else one.input_columns
            wanted: tuple[tuple[Kind, int, int, int, int], ...] = (
                ("forward", one.rows, fan_in, fan_out, one.forward),
                ("weight gradient", fan_in, one.rows, fan_out, one.backward),
                ("signal", one.rows, fan_out, back_to, one.signal_passes if back_to else 0),
            )
            for kind, m, k, n, times in wanted:
                key = (kind, m, k, n)
                shares[key] = shares.get(key, Fraction(0)) + Fraction(times * one.heads, one.every)
    found = [Product(*key, count) for key, count in shares.items() if count]
    return sorted(found, key=lambda product: -product.flops)


def flops(passes: Sequence[Pass]) -> float:
    """Operations per step."""
    return float(sum(product.flops for product in products(passes)))


def dilo(shapes: Shapes, batch: int, hidden: Sequence[int], account: Account = "needed") -> tuple[Pass, ...]:
    """DILO: 20 critic passes as released, 18 without the one that nothing uses, 10 backward, and the policy.

    The linear term's gradient stays apart, because kappa is computed without it.
    """
    value = (2 * shapes.observation, *hidden, 1)
    policy = (shapes.observation, *hidden, shapes.action)
    passes = [
        Pass("target values", value, 4 * batch, heads=2),
        Pass("values at (s, s')", value, 2 * batch, heads=2, backward=1),
        Pass("values at (s', s'')", value, 2 * batch, heads=2, backward=1),
        # The output is one number, so a row's signals are those of the forward loss times a scalar.
        Pass("linear term", value, batch, heads=2, forward=0, backward=1, signals=0 if account == "shared" else None),
        Pass("policy weights", value, batch, heads=2),
        Pass("policy", policy, batch, backward=1),
    ]
    if account == "released":
        passes.append(Pass("values at the expert's (s', s'') again", value, batch, heads=2))
    return tuple(passes)


def smodice(shapes: Shapes, batch: int, hidden: Sequence[int], account: Account = "needed") -> tuple[Pass, ...]:
    """SMODICE's main stage: three values with full gradient, the policy, the reward."""
    value = (shapes.observation, *hidden, 1)
    return (
        Pass("values at s, s' and s_0", value, 3 * batch, backward=1),
        Pass("reward", value, batch),
        *bc(shapes, batch, hidden, account),
    )


def oril(shapes: Shapes, batch: int, hidden: Sequence[int], account: Account = "needed") -> tuple[Pass, ...]:
    """ORIL's main stage. Released, the actor's loss fills the first critic's gradients, which no formula uses."""
    actor = (shapes.observation, *hidden, shapes.action)
    critic = (shapes.observation + shapes.action, *hidden, 1)
    released = account == "released"
    return (
        Pass("reward", (shapes.observation, *hidden, 1), batch),
        Pass("target actions", actor, batch),
        Pass("target values", critic, batch, heads=2),
        Pass("values", critic, batch, heads=2, backward=1),
        Pass("actions", actor, batch, backward=1, every=2),
        Pass(
            "values of actions",
            critic,
            batch,
            backward=1 if released else 0,
            signals=1,
            input_columns=critic[0] if released else shapes.action,
            every=2,
        ),
    )


def bc(shapes: Shapes, batch: int, hidden: Sequence[int], account: Account = "needed") -> tuple[Pass, ...]:
    """The squashed Gaussian of BC and SMODICE, mean and log-std side by side."""
    return (Pass("policy", (shapes.observation, *hidden, 2 * shapes.action), batch, backward=1),)


def bco_inverse_dynamics(
    shapes: Shapes, batch: int, hidden: Sequence[int], account: Account = "needed"
) -> tuple[Pass, ...]:
    """BCO's first stage."""
    return (Pass("inverse dynamics", (2 * shapes.observation, *hidden, shapes.action), batch, backward=1),)


def bco_policy(shapes: Shapes, batch: int, hidden: Sequence[int], account: Account = "needed") -> tuple[Pass, ...]:
    """BCO's second stage, and any cloning by squared error; the demonstration is labelled once, before it."""
    return (Pass("policy", (shapes.observation, *hidden, shapes.action), batch, backward=1),)


Inventory = Callable[[Shapes, int, Sequence[int], Account], tuple[Pass, ...]]


@dataclass(frozen=True)
class Work:
    """One product, its result's storage included."""

    left: Tensor
    right: Tensor
    out: Tensor


def floor(passes: Sequence[Pass], seeds: int, device: torch.device) -> Callable[[], None]:
    """A call that runs one step's products for all seeds.

    On a CPU entry after entry of the leading axis, S seeds times H heads, a pass without gradient in blocks of rows
    that stay in the cache; on CUDA as batched products over that axis, replayed as a graph. A pass's products feed each
    other, as they do in a step.

    Args:
        passes: an inventory of benchmarks/flops.py.
        seeds: S.
        device: where the buffers lie; they are all allocated here.
    """
    recorder = recorder_for(device)

    def multiplied(works: Sequence[Work]) -> Callable[[], None]:
        _multiply(works)  # libraries set themselves up
        return partial(_multiply, works) if recorder is None else recorder(partial(_multiply, works))

    every_step = multiplied([work for one in passes if one.every == 1 for work in _works(one, seeds, device)])
    rare = [(one.every, multiplied(_works(one, seeds, device))) for one in passes if one.every > 1]
    step = 0

    def run() -> None:
        nonlocal step
        step += 1
        every_step()
        for every, multiply in rare:
            if step % every == 0:
                multiply()

    return run


def _multiply(works: Sequence[Work]) -> None:
    for work in works:
        if work.left.dim() == 2:
            torch.mm(work.left, work.right, out=work.out)
        else:
            torch.bmm(work.left, work.right, out=work.out)


def _works(one: Pass, seeds: int, device: torch.device) -> list[Work]:
    """The products of a pass in the order in which a step needs them."""
    entries = seeds * one.heads
    if device.type == "cuda":
        return _entry_works(one, (entries,), device)
    return [work for _ in range(entries) for work in _entry_works(one, (), device)]


def _entry_works(one: Pass, leading: tuple[int, ...], device: torch.device) -> list[Work]:
    def random(*size: int) -> Tensor:
        return torch.randn(*leading, *size, device=device)

    # Weights that keep numbers near one, so that no product meets infinities or denormals.
    weights = [random(*sizes) / math.sqrt(sizes[0]) for sizes in pairwise(one.sizes)]
    if not leading and not one.backward and not one.signal_passes:
        given = random(one.rows, one.sizes[0])
        return _in_blocks(one, given, weights)
    hidden = [random(one.rows, width) for width in one.sizes]
    works: list[Work] = []
    for _ in range(one.forward):
        works += [Work(hidden[layer], weight, hidden[layer + 1]) for layer, weight in enumerate(weights)]
    # The last is what the loss hands in; the others are products of it.
    signals = [random(one.rows, width) for width in one.sizes]
    last = len(weights) - 1
    for index in range(max(one.backward, one.signal_passes)):
        for layer in range(last, -1, -1):
            if index < one.backward:
                works.append(Work(hidden[layer].mT, signals[layer + 1], torch.empty_like(weights[layer])))
            back_to = one.sizes[layer] if layer else one.input_columns
            if index < one.signal_passes and back_to:
                weight = weights[layer][..., :back_to, :].mT
                # An input's gradient may want some of the columns only, and nothing here reads it.
                out = signals[layer] if layer else signals[0].new_empty(*leading, one.rows, back_to)
                works.append(Work(signals[layer + 1], weight, out))
    return works


def _in_blocks(one: Pass, given: Tensor, weights: Sequence[Tensor]) -> list[Work]:
    """Forward products, a block of rows through all layers before the next."""
    block = min(ROWS_IN_CACHE, one.rows)
    hidden = [torch.empty(block, width) for width in one.sizes[1:]]
    works: list[Work] = []
    for _ in range(one.forward):
        for rows in given.split(block):
            left = rows
            for weight, buffer in zip(weights, hidden, strict=True):
                out = buffer[: len(rows)]
                works.append(Work(left, weight, out))
                left = out
    return works
