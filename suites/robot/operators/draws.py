"""Randomness of recordings: every episode draws from a generator of its own, whatever is recorded beside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Draws:
    """Draws for episodes that are recorded in lock step.

    Args:
        generator: decides the episodes' seeds; the first episodes of a longer recording are those of a shorter one.
        episodes: how many, n.
    """

    def __init__(self, generator: np.random.Generator, episodes: int) -> None:
        self.episodes = episodes
        self.seeds: Integers = generator.integers(2**31, size=episodes)
        self._generators = [np.random.Generator(np.random.Philox(int(seed))) for seed in self.seeds]

    def uniform(self, low: float, high: float, *shape: int) -> Array:
        """``[n, *shape]``, uniform between `low` and `high`."""
        drawn: Array = low + (high - low) * np.stack([each.random(shape) for each in self._generators])
        return drawn

    def normal(self, scale: float, *shape: int) -> Array:
        """``[n, *shape]``, Gaussian with standard deviation `scale`."""
        drawn: Array = scale * np.stack([each.standard_normal(shape) for each in self._generators])
        return drawn

    def happens(self, probability: float, *shape: int) -> NDArray[np.bool_]:
        """``[n, *shape]``, each True with `probability`."""
        return self.uniform(0.0, 1.0, *shape) < probability
