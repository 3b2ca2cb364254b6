"""The overhead camera: where it says that a coloured thing is, once per control step.

A reading is the true position one frame ago, plus the episode's calibration error, plus noise; when the colour is not
found, the last reading is held. Everything random is drawn when the episodes begin, from every world's own streams.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from suites.robot import constants
from suites.robot.servo import SUBSTEPS
from suites.robot.streams import stream

Array = NDArray[np.float64]

SUBSTEPS_OF_LATENCY = round(constants.CAMERA_LATENCY * constants.PHYSICS_RATE / constants.CAMERA_RATE)
"""Physics substeps between the picture and the reading."""


def pictured(path: Array) -> Array:
    """Where a thing is in the newest finished picture ``[n, 2]``, from its ``[n, SUBSTEPS, 2]`` at substeps' ends."""
    return path[:, SUBSTEPS - 1 - SUBSTEPS_OF_LATENCY]


class Camera:
    """Readings of n worlds.

    Args:
        seeds: one per world.
        readings: how many per world can differ; later ones repeat the last one's error.
    """

    def __init__(self, seeds: Sequence[int], readings: int) -> None:
        bias = np.stack([stream(seed, "bias").standard_normal(2) for seed in seeds])
        noise = np.stack([stream(seed, "noise").standard_normal((readings, 2)) for seed in seeds], axis=1)
        self._error: Array = bias * constants.CAMERA_BIAS + noise * constants.CAMERA_NOISE
        lost = np.stack([stream(seed, "dropout").random(readings) for seed in seeds], axis=1) < constants.CAMERA_DROPOUT
        lost[0] = False
        self._lost = lost[:, :, None]
        self._next = 0
        self._held: Array = np.zeros((len(seeds), 2))

    def read(self, position: Array) -> Array:
        """The next reading ``[n, 2]`` of things that are at ``[n, 2]`` in the picture."""
        index = min(self._next, len(self._error) - 1)
        self._held = np.where(self._lost[index], self._held, position + self._error[index])
        self._next += 1
        return self._held
