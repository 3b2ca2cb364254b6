"""Whether an effector keeps its place: it has stayed near one point since so many control steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from suites.robot import constants

Array = NDArray[np.float64]


class Rest:
    """Rest of n effectors; a place is left as soon as the effector is farther from it than the rest radius.

    A net displacement, not a speed: a policy that trembles on the spot is at rest, one that creeps on is not.

    Args:
        position: ``[n, 2]`` where they begin, in metres.
    """

    def __init__(self, position: Array) -> None:
        self._place = position
        self._steps = np.zeros(len(position), dtype=np.int64)

    def update(self, position: Array) -> NDArray[np.int64]:
        """Control steps ``[n]`` for which the place has been kept, now that the effectors are at ``[n, 2]``."""
        away = position - self._place
        away *= away
        left = away[:, 0] + away[:, 1] > float(constants.REST_RADIUS) ** 2
        self._place = np.where(left[:, None], position, self._place)
        self._steps = np.where(left, 0, self._steps + 1)
        return self._steps
