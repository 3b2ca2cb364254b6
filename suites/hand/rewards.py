"""D4RL's dense rewards of a step, from positions and velocities (Rajeswaran et al., 2018, arXiv:1709.10087, appendix).

Positions are ``[3]`` in metres, directions ``[3]`` of length 1, angles in radians, velocities ``[joints]``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OPEN = 1.57
"""Angle of the open door."""
IN_PLACE = 0.075
"""Metres from its goal within which the pen is in place."""
DROPPED_BELOW = 0.075
"""Height in metres below which the pen has fallen out of the hand."""
LIFTED_ABOVE = 0.04
"""Height in metres above which the hammer has left the table."""


def pen(position: Array, goal: Array, direction: Array, wanted: Array) -> float:
    """Cosine between the pen and the wanted direction, less the distance to the goal, and bonuses.

    10 for being in place at a cosine above 0.9, 50 more above 0.95, and -5 for a dropped pen.
    """
    distance, cosine = _distance(position, goal), float(direction @ wanted)
    reward = cosine - distance
    if distance < IN_PLACE:
        reward += 10.0 * (cosine > 0.9) + 50.0 * (cosine > 0.95)
    return reward - 5.0 * dropped(position)


def dropped(position: Array) -> bool:
    """Whether the pen was dropped, which ends the episode."""
    return bool(position[2] < DROPPED_BELOW)


def door(palm: Array, handle: Array, hinge: float, velocities: Array) -> float:
    """Costs of the palm's distance to the handle, of the angle still to go and of motion, and bonuses.

    2 above an angle of 0.2, 8 more above 1.0, 10 more above 1.35.
    """
    cost = 0.1 * _distance(palm, handle) + 0.1 * (hinge - OPEN) ** 2 + 1e-5 * float(velocities @ velocities)
    return 2.0 * (hinge > 0.2) + 8.0 * (hinge > 1.0) + 10.0 * (hinge > 1.35) - cost


def hammer(palm: Array, handle: Array, head: Array, nail: Array, goal: Array, velocities: Array) -> float:
    """Costs of three distances (palm to handle, head to nail, nail to goal) and of motion, and bonuses.

    2 for a lifted hammer, 25 for a nail within 2 cm of its goal, 75 more within 1 cm.
    """
    left = _distance(nail, goal)
    cost = 0.1 * _distance(palm, handle) + _distance(head, nail) + 10.0 * left
    cost += 0.01 * float(np.linalg.norm(velocities))
    lifted = handle[2] > LIFTED_ABOVE and head[2] > LIFTED_ABOVE
    return float(2.0 * lifted + 25.0 * (left < 0.02) + 75.0 * (left < 0.01) - cost)


def _distance(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other))
