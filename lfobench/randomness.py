"""Stateless randomness: what is drawn depends only on (seed, purpose, step, index).

Philox-4x32-10 (Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011) written in
int64 tensor operations, so the same words come out on CPU and GPU, alone or beside other seeds, before or after
a resume, and inside a captured graph. The key is (seed, purpose); the counter is (index, step).
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Protocol

import torch

if TYPE_CHECKING:
    from torch import Tensor

_MASK = 0xFFFFFFFF
_MULTIPLIERS = (0xD2511F53, 0xCD9E8D57)
_WEYL = (0x9E3779B9, 0xBB67AE85)
_ROUNDS = 10


def philox(counter: tuple[Tensor, Tensor, Tensor, Tensor], key: tuple[Tensor, Tensor]) -> tuple[Tensor, ...]:
    """Four 32-bit words per counter.

    Args:
        counter: four broadcastable int64 tensors holding 32-bit words.
        key: two broadcastable int64 tensors holding 32-bit words.

    Returns:
        Four int64 tensors with values in [0, 2**32).
    """
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(_ROUNDS):
        # The int64 product wraps modulo 2**64; its bit pattern is that of the unsigned product.
        low_product, high_product = c0 * _MULTIPLIERS[0], c2 * _MULTIPLIERS[1]
        c0, c1, c2, c3 = (
            ((high_product >> 32) & _MASK) ^ c1 ^ k0,
            high_product & _MASK,
            ((low_product >> 32) & _MASK) ^ c3 ^ k1,
            low_product & _MASK,
        )
        k0, k1 = (k0 + _WEYL[0]) & _MASK, (k1 + _WEYL[1]) & _MASK
    return c0, c1, c2, c3


@cache
def purpose_word(purpose: str) -> int:
    """The 32-bit key word of a purpose such as ``"offline batch"``."""
    return zlib.crc32(purpose.encode())


class Randomness:
    """Draws for a fixed list of seeds on one device.

    Args:
        seeds: one non-negative integer below 2**32 per entry of the seed axis.
        device: where the draws are made.
    """

    def __init__(self, seeds: Sequence[int], device: torch.device | str = "cpu") -> None:
        self.seeds = tuple(seeds)
        self.device = torch.device(device)
        self._seeds = torch.tensor(self.seeds, dtype=torch.int64, device=self.device)

    def words(self, purpose: str, step: int | Tensor, count: int) -> Tensor:
        """32-bit words, int64 ``[S, count]``, or ``[K, S, count]`` when `step` is a tensor ``[K]``."""
        steps = torch.as_tensor(step, dtype=torch.int64, device=self.device)
        blocks = torch.arange((count + 3) // 4, dtype=torch.int64, device=self.device)
        step_low, step_high = (steps & _MASK)[..., None, None], (steps >> 32)[..., None, None]
        seed = self._seeds[:, None]
        zero = torch.zeros_like(blocks)
        words = philox(
            (blocks + zero, step_low + zero, step_high + zero, zero),
            (seed, torch.full_like(seed, purpose_word(purpose))),
        )
        drawn = torch.stack(torch.broadcast_tensors(*words), dim=-1)
        return drawn.flatten(-2)[..., :count]

    def integers(self, purpose: str, step: int | Tensor, count: int, bound: int) -> Tensor:
        """Integers in [0, bound), shaped as `words`; with replacement.

        A word w maps to floor(w * bound / 2**32); no value is favoured by more than bound / 2**32.
        """
        if not 0 < bound <= _MASK:
            raise ValueError(f"bound must be in [1, 2**32), got {bound}")
        return (self.words(purpose, step, count) * bound) >> 32 & _MASK

    def uniform(self, purpose: str, step: int | Tensor, count: int) -> Tensor:
        """float32 in (0, 1), shaped as `words`: 23-bit grid, moved by half a cell off the end points.

        One bit more and the half cell would be lost to rounding above 0.5, and 1.0 could be drawn.
        """
        return ((self.words(purpose, step, count) >> 9).to(torch.float32) + 0.5) * 2.0**-23

    def normal(self, purpose: str, step: int | Tensor, count: int) -> Tensor:
        """float32 standard normal, shaped as `words` (Box and Muller 1958)."""
        pairs = (count + 1) // 2
        uniform = self.uniform(purpose, step, 2 * pairs).unflatten(-1, (pairs, 2))
        radius = torch.sqrt(-2.0 * torch.log(uniform[..., 0]))
        angle = (2.0 * math.pi) * uniform[..., 1]
        normal = torch.stack((radius * torch.cos(angle), radius * torch.sin(angle)), dim=-1)
        return normal.flatten(-2)[..., :count]

    def permutation(self, purpose: str, step: int | Tensor, count: int) -> Tensor:
        """One permutation of 0..count-1 per seed, int64 shaped as `words`."""
        # On a CPU, int32 in one dimension is sorted by its digits, several times faster than by comparisons.
        keys = (self.words(purpose, step, count) - 2**31).to(torch.int32)
        return torch.argsort(keys.squeeze(0), dim=-1, stable=True).view(keys.shape)


class StepRandomness(Protocol):
    """The draws of one training step, handed to a method's update.

    The update may be recorded once and replayed for every other step of the same phase, so what it does in Python may
    depend on the phase and on nothing else that changes.
    """

    @property
    def phase(self) -> int:
        """The step's place in the stage's period: updates of the stage before it, modulo `Stage.period`."""
        ...

    def normal(self, purpose: str, *shape: int) -> Tensor:
        """float32 standard normal ``[S, *shape]``."""
        ...

    def uniform(self, purpose: str, *shape: int) -> Tensor:
        """float32 in (0, 1), ``[S, *shape]``."""
        ...
