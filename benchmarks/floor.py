"""A step's matrix products and nothing else, done as the engine does them: what is left is everything but products."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import torch
from torch import Tensor

from benchmarks.flops import Pass
from lfobench.engine.program import recorder_for
from lfobench.nn.perceptron import ROWS_IN_CACHE


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
