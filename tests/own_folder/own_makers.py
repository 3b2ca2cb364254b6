"""Who makes the data of the cart: in the cart's own units."""

from __future__ import annotations

from typing import Any

import numpy as np

from lfobench.contract.suite import FloatArray, Level


class Pusher:
    """Uniform pushes in the box, or as far to the right as it goes."""

    def __init__(self, space: Any, level: Level) -> None:
        self._space, self._level = space, level

    @property
    def fingerprint(self) -> str:
        return f"pusher {self._level}"

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        low, high = np.maximum(self._space.low, -5.0), np.minimum(self._space.high, 5.0)
        if self._level == "expert":
            return np.asarray(high, np.float32)
        return generator.uniform(low, high).astype(np.float32)
