"""The Gymnasium spaces of the three tasks, and what every environment built on them says of itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box

from suites.robot import constants
from suites.robot.tasks import RobotTask

METADATA: dict[str, Any] = {"render_modes": [], "render_fps": int(constants.CONTROL_RATE)}

# A reading of the camera may lie a little off the table; bias and noise stay far below this.
_SLACK = 0.1


def action_space() -> Box:
    """Two fractions of the robot's clip."""
    return Box(-1.0, 1.0, (2,), np.float32)


def observation_space(task: RobotTask) -> Box:
    """Bounds that no observation passes: the table for positions, the arm's limits for its velocity."""
    slack, side = _SLACK, float(constants.TABLE_WIDTH) / 2
    low, high = [-slack, -side - slack], [constants.TABLE_LENGTH + slack, side + slack]
    if task.puck == "resting":
        low, high = low * 2, high * 2
    elif task.puck == "sliding":
        fastest = 2.0 * float(constants.VELOCITY_LIMIT)
        apart = [constants.TABLE_LENGTH + slack, 2 * side + slack]
        low = low + [-fastest] * 2 + [-limit for limit in apart] * int(constants.RELATIVE_POSITIONS)
        high = high + [fastest] * 2 + apart * int(constants.RELATIVE_POSITIONS)
    return Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)
