"""Places that come to somebody's mind, and the choice among them."""

from __future__ import annotations

import numpy as np

from suites.robot.operators.draws import Array, Draws, Integers
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW


def around(draws: Draws, least: float, greatest: float, *shape: int) -> Array:
    """``[n, *shape, 2]`` metres away in every direction, by distances between `least` and `greatest`."""
    angle, distance = draws.uniform(0.0, 2.0 * np.pi, *shape), draws.uniform(least, greatest, *shape)
    away: Array = distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return away


def folded(places: Array) -> Array:
    """Places ``[..., 2]`` beyond the workspace's edges, mirrored into it; clipping would pile them up there."""
    inside: Array = WORKSPACE_HIGH - np.abs(WORKSPACE_HIGH - WORKSPACE_LOW - np.abs(places - WORKSPACE_LOW))
    return inside


def choose(clearance: Array, wanted: Array) -> Integers:
    """``[n]``: of clearances ``[n, T]`` the first that is as wanted ``[n]``, or else the greatest."""
    enough = clearance >= wanted[:, None]
    return np.where(enough.any(-1), enough.argmax(-1), clearance.argmax(-1))
