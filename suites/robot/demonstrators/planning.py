"""Planning of the scripted demonstrators: shortest paths round obstacles, predictions of the puck, places to go to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from suites.robot import constants, tasks
from suites.robot.demonstrators.human_motion import PERIOD, Array, Draws, Integers
from suites.robot.model import TILT_ACCELERATION
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW

CORNERS = 12
"""Points around an obstacle at which a path may bend."""
BENDS = 7
"""Points of a path after its start."""


class Routes:
    """Shortest paths to a goal over a visibility graph.

    Args:
        centers: ``[m, 2]`` of the obstacles.
        distance: metres to be kept from them.
        goal: ``[2]``.
        low: ``[2]`` smallest x and y of a path's bends.
        high: ``[2]`` largest.
    """

    def __init__(self, centers: Array, distance: float, goal: Array, low: Array, high: Array) -> None:
        self._centers, self._distance = centers, distance
        angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
        directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        # Far enough out for the straight line between two neighbours to keep the distance.
        corners = (centers[:, None] + (distance / np.cos(np.pi / CORNERS) + 1e-6) * directions).reshape(-1, 2)
        free = (_between(corners, centers) >= distance).all(-1) & ((corners > low) & (corners < high)).all(-1)
        self.points = np.concatenate([corners[free], goal[None]])
        self._outward = np.concatenate([np.tile(directions, (len(centers), 1))[free], np.zeros((1, 2))])
        visible = self.visible(self.points[:, None], self.points[None])
        self._to_go, self._next = _shortest(np.where(visible, _between(self.points, self.points), np.inf))

    def visible(self, start: Array, end: Array) -> NDArray[np.bool_]:
        """Whether straight lines between points of shapes that broadcast, ``[..., 2]``, keep their distance.

        A line that starts too near an obstacle may leave it, and must not come nearer.
        """
        along = end - start
        square = np.maximum((along * along).sum(-1), 1e-12)
        offset = self._centers - start[..., None, :]
        share = np.clip((offset * along[..., None, :]).sum(-1) / square[..., None], 0.0, 1.0)
        nearest = np.linalg.norm(offset - share[..., None] * along[..., None, :], axis=-1)
        allowed = np.minimum(self._distance, np.linalg.norm(offset, axis=-1))
        clear: NDArray[np.bool_] = (nearest >= allowed - 1e-9).all(-1)
        return clear

    def plan(self, starts: Array, taste: Array, berth: Array) -> Array:
        """Bends ``[n, BENDS, 2]`` of paths from `starts` ``[n, 2]``; a path that has reached the goal stays there.

        Args:
            starts: where the paths begin.
            taste: ``[n, points]`` relative costs, which make a longer way win now and then.
            berth: ``[n]`` metres that the bends lie farther out than necessary.
        """
        visible = self.visible(starts[:, None], self.points[None])
        cost = np.where(visible, _between(starts, self.points) + self._to_go * (1.0 + taste), np.inf)
        # Where no point is visible, the way is straight to the goal.
        node = np.where(np.isfinite(cost).any(-1), cost.argmin(-1), len(self.points) - 1)
        bends = np.empty((len(starts), BENDS, 2))
        for bend in range(BENDS):
            bends[:, bend] = self.points[node] + berth[:, None] * self._outward[node]
            node = self._next[node]
        return bends


def _between(first: Array, second: Array) -> Array:
    """Distances ``[n, m]`` between points ``[n, 2]`` and ``[m, 2]``."""
    distance: Array = np.linalg.norm(first[:, None] - second[None], axis=-1)
    return distance


def _shortest(steps: Array) -> tuple[Array, NDArray[np.int64]]:
    """Distance to the last point and the point that comes next, both ``[points]`` (Bellman 1958)."""
    goal = len(steps) - 1
    to_go = np.where(np.arange(len(steps)) == goal, 0.0, np.inf)
    away = steps + np.diag(np.where(np.arange(len(steps)) == goal, 0.0, np.inf))
    for _ in range(len(steps)):
        to_go = (away + to_go).min(-1)
    return to_go, (away + to_go).argmin(-1)


SIDE = float(constants.TABLE_WIDTH) / 2 - tasks.PUCK_RADIUS
NEAR, FAR = tasks.PUCK_RADIUS, float(constants.TABLE_LENGTH) - tasks.PUCK_RADIUS
KEPT = float(constants.WALL_RESTITUTION)


class DelayedView:
    """Delayed knowledge of n pucks: position and velocity, a reaction time ago.

    Args:
        delay: ``[n]`` reaction times in control steps.
    """

    def __init__(self, delay: Integers) -> None:
        self._delay, self._rows = delay, np.arange(len(delay))
        self._observed: list[Array] = []

    def add(self, position: Array, velocity: Array) -> None:
        """Add the next step's positions ``[n, 2]`` and velocities ``[n, 2]``."""
        latest = np.concatenate([position, velocity], axis=-1)
        kept = int(self._delay.max()) + 1
        # Before the first step, all was as it is then.
        self._observed = [*(self._observed or [latest] * kept), latest][-kept:]

    def predict(self, steps: int) -> Array:
        """Predicted positions ``[n, steps, 2]`` at the ends of the next steps."""
        known = np.stack(self._observed)[-1 - self._delay, self._rows]
        path = sliding_path(known[:, :2], known[:, 2:], steps + int(self._delay.max()))
        shift = self._delay[:, None] + np.arange(steps)
        predicted: Array = path[self._rows[:, None], shift]
        return predicted


def sliding_path(position: Array, velocity: Array, steps: int) -> Array:
    """Positions ``[n, steps, 2]`` at the next steps' ends of pucks at `position` ``[n, 2]`` with `velocity` ``[n, 2]``.

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
    """Time and place at which a path ``[n, steps, 2]`` crosses a line at x = `line` ``[n]``, downhill.

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


def displacements(draws: Draws, least: float, greatest: float, *shape: int) -> Array:
    """Displacements ``[n, *shape, 2]`` in uniform directions, by distances between `least` and `greatest` metres."""
    angle, distance = draws.uniform(0.0, 2.0 * np.pi, *shape), draws.uniform(least, greatest, *shape)
    away: Array = distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return away


def mirrored(places: Array) -> Array:
    """Places ``[..., 2]``, mirrored at the workspace's edges into it; clipping would accumulate them at the edges."""
    inside: Array = WORKSPACE_HIGH - np.abs(WORKSPACE_HIGH - WORKSPACE_LOW - np.abs(places - WORKSPACE_LOW))
    return inside


def first_clear(clearance: Array, wanted: Array) -> Integers:
    """Index ``[n]`` of the first clearance ``[n, T]`` that is as wanted ``[n]``, or else of the greatest."""
    enough = clearance >= wanted[:, None]
    return np.where(enough.any(-1), enough.argmax(-1), clearance.argmax(-1))
