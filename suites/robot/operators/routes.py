"""Ways round what stands on the table: corners about every obstacle, and the shortest path over those in sight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from suites.robot.operators.draws import Array

CORNERS = 12
"""Points about an obstacle at which a path may bend."""
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
            taste: ``[n, points]`` relative dislikes, which make one go a longer way round now and then.
            berth: ``[n]`` metres by which the bends lie farther out than they must.
        """
        seen = self.visible(starts[:, None], self.points[None])
        cost = np.where(seen, _between(starts, self.points) + self._to_go * (1.0 + taste), np.inf)
        # Hemmed in on all sides, somebody goes straight for the goal.
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
