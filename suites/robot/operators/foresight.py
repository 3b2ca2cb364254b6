"""Where a sliding puck will be, as somebody sees it who has watched many: the tilt pulls it, rails throw it back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from suites.robot import constants, tasks
from suites.robot.model import TILT_ACCELERATION
from suites.robot.operators.draws import Array, Integers
from suites.robot.operators.journeys import PERIOD

SIDE = float(constants.TABLE_WIDTH) / 2 - tasks.PUCK_RADIUS
NEAR, FAR = tasks.PUCK_RADIUS, float(constants.TABLE_LENGTH) - tasks.PUCK_RADIUS
KEPT = float(constants.WALL_RESTITUTION)


class Eyes:
    """What n people know of a puck: where it was and how it moved, a reaction time ago.

    Args:
        delay: ``[n]`` control steps by which everything is seen late.
    """

    def __init__(self, delay: Integers) -> None:
        self._delay, self._rows = delay, np.arange(len(delay))
        self._seen: list[Array] = []

    def look(self, position: Array, velocity: Array) -> None:
        """See, a step after the last look, a puck at ``[n, 2]`` with a velocity ``[n, 2]``."""
        latest = np.concatenate([position, velocity], axis=-1)
        kept = int(self._delay.max()) + 1
        # Before the first look everything was as it is then.
        self._seen = [*(self._seen or [latest] * kept), latest][-kept:]

    def foresee(self, steps: int) -> Array:
        """``[n, steps, 2]``: where it will be at the ends of the next steps, as far as was seen."""
        known = np.stack(self._seen)[-1 - self._delay, self._rows]
        path = glide(known[:, :2], known[:, 2:], steps + int(self._delay.max()))
        shift = self._delay[:, None] + np.arange(steps)
        seen: Array = path[self._rows[:, None], shift]
        return seen


def glide(position: Array, velocity: Array, steps: int) -> Array:
    """``[n, steps, 2]``: where pucks at `position` ``[n, 2]`` with `velocity` ``[n, 2]`` are at the next steps' ends.

    Exact between bounces (``x + v t - a t^2 / 2``); a bounce is mirrored within its step.
    """
    (x, y), (along, across) = position.T.copy(), velocity.T.copy()
    path = np.empty((len(position), steps, 2))
    for step in range(steps):
        x = x + along * PERIOD - 0.5 * TILT_ACCELERATION * PERIOD**2
        along = along - TILT_ACCELERATION * PERIOD
        y = y + across * PERIOD
        x, along = _bounced(x, along, NEAR, FAR)
        y, across = _bounced(y, across, -SIDE, SIDE)
        path[:, step, 0], path[:, step, 1] = x, y
    return path


def _bounced(place: Array, speed: Array, low: float, high: float) -> tuple[Array, Array]:
    kept = np.clip(place, low, high)
    out = place != kept
    return kept + KEPT * (kept - place), np.where(out, -KEPT * speed, speed)


def crossing(path: Array, line: Array) -> tuple[NDArray[np.int64], Array]:
    """When and where a path ``[n, steps, 2]`` comes down over a line across the table at x = `line` ``[n]``.

    Returns:
        The step ``[n]`` at whose end it is below, counted from 1; the number of steps plus 1 where it never is; and
        the place y ``[n]`` there.
    """
    below = (path[:, 1:, 0] < line[:, None]) & (path[:, :-1, 0] >= line[:, None])
    comes = below.any(-1)
    index = np.where(comes, below.argmax(-1) + 1, path.shape[1] - 1)
    rows = np.arange(len(path))
    before, after = path[rows, index - 1], path[rows, index]
    share = np.clip((before[:, 0] - line) / np.maximum(before[:, 0] - after[:, 0], 1e-9), 0.0, 1.0)
    place = before[:, 1] + share * (after[:, 1] - before[:, 1])
    return np.where(comes, index + 1, path.shape[1] + 1), place
