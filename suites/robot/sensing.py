"""What a task's policy observes: the arm's pose and velocity by its encoders, which are exact, the rest by the camera.

| task | observation |
|---|---|
| safe manipulation, robot | effector x, y by the encoders |
| safe manipulation, hand | the same two numbers by the camera, which tracks the carried object |
| puck striking | effector x, y by the encoders; puck x, y by the camera |
| dynamic hitting | effector x, y and velocity x, y by the encoders; five times puck minus effector x, y, newest first |

A relative position is the camera's reading less the encoders' reading of the same control step. Before the first step
the puck is held where it is let go, so all five are equal then.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import FloatArray
from suites.robot import constants
from suites.robot.camera import Camera
from suites.robot.tasks import RobotTask

Array = NDArray[np.float64]


class Sensing:
    """Observations of n worlds of a task.

    Args:
        task: decides what is seen.
        eye: its camera, fresh.
    """

    def __init__(self, task: RobotTask, eye: Camera) -> None:
        self._task = task
        self._eye = eye
        self._relative: Array | None = None

    def observe(self, effector: Array, velocity: Array, pictured: Array | None) -> FloatArray:
        """The next observations ``[n, obs]``.

        Args:
            effector: ``[n, 2]`` true positions now.
            velocity: ``[n, 2]`` true velocities now.
            pictured: ``[n, 2]`` true positions, one frame ago, of what the camera tracks; None where it tracks nothing.
        """
        seen = [effector] if pictured is None else [effector, self._eye.read(pictured)]
        if self._task.puck == "none":
            return seen[-1].astype(np.float32)
        if self._task.puck == "resting":
            return np.concatenate(seen, axis=1, dtype=np.float32)
        newest = seen[1] - effector
        if self._relative is None:
            self._relative = np.tile(newest, int(constants.RELATIVE_POSITIONS))
        else:
            self._relative = np.concatenate((newest, self._relative[:, :-2]), axis=1)
        return np.concatenate((effector, velocity, self._relative), axis=1, dtype=np.float32)
