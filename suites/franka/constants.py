"""Constants of D4RL's kitchen: sub-tasks, their coordinates in an observation, their goals, the sensors' noise."""

from __future__ import annotations

from typing import Literal

import numpy as np

from lfobench.contract.episodes import FloatArray

Variant = Literal["complete", "partial", "mixed"]
Layout = Literal["d4rl-with-goal", "d4rl-without-goal", "minari"]

SUB_TASKS: dict[Variant, tuple[str, ...]] = {
    "complete": ("microwave", "kettle", "light switch", "slide cabinet"),
    "partial": ("microwave", "kettle", "light switch", "slide cabinet"),
    "mixed": ("microwave", "kettle", "bottom burner", "light switch"),
}
"""The four scored sub-tasks of D4RL's environments of these names."""

ROBOT, OBJECTS = 9, 21
"""Joints of arm and gripper, and coordinates of the objects: together the 30 of a configuration."""
JOINTS = 7
"""Joints of the arm, which come first; the two fingers come after them."""

GOALS: dict[str, tuple[slice, tuple[float, ...]]] = {
    "bottom burner": (slice(11, 13), (-0.88, -0.01)),
    "top burner": (slice(15, 17), (-0.92, -0.01)),
    "light switch": (slice(17, 19), (-0.69, -0.05)),
    "slide cabinet": (slice(19, 20), (0.37,)),
    "hinge cabinet": (slice(20, 22), (0.0, 1.45)),
    "microwave": (slice(22, 23), (-0.75,)),
    "kettle": (slice(23, 30), (-0.23, 0.75, 1.62, 0.99, 0.0, 0.0, -0.06)),
}
"""Coordinates of a sub-task in a configuration (radians, metres, a quaternion), and their goal."""

NOISE_RATIO = 0.1
"""Noise ratio of D4RL's sensors; gymnasium-robotics has less."""
OBJECT_NOISE = np.array(
    [0.005] * 2 + [0.0005] * 6 + [0.005] * 3 + [0.1] * 3 + [0.005] * 3 + [0.1] * 3 + [0.005], np.float64
)
"""Amplitude ``[21]`` of the noise on every object coordinate at ratio 1."""


def goal(variant: Variant) -> FloatArray:
    """D4RL's goal vector ``[30]``: the goals of the scored sub-tasks, and zero everywhere else."""
    vector = np.zeros(ROBOT + OBJECTS, np.float32)
    for name in SUB_TASKS[variant]:
        place, wanted = GOALS[name]
        vector[place] = wanted
    return vector
