"""The random numbers of a world: streams that its seed and their purpose alone decide."""

from __future__ import annotations

from typing import Literal

import numpy as np

Purpose = Literal["start", "bias", "noise", "dropout"]
PURPOSES: tuple[Purpose, ...] = ("start", "bias", "noise", "dropout")


def stream(seed: int, purpose: Purpose) -> np.random.Generator:
    """A generator of its own for every purpose, so that drawing more of one thing changes no other."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence((seed, PURPOSES.index(purpose)))))
