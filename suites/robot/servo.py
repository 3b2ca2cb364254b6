"""The arm: a first-order servo with a velocity limit and a workspace, realised by a force-limited actuator.

Pure functions over n worlds. Between two control steps the servo's reference moves straight at its target, at the
velocity limit while the target is far and with the first-order law ``d' = -d / tau`` once that is slower. The actuator
asks for whatever force makes the arm's velocity the reference's within one substep, and gives at most its limit.

No transcendental function is taken of a world's own numbers: vectorised ones may round differently at the end of an
array, and a world's bits must not depend on how many worlds there are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from suites.robot import constants

Array = NDArray[np.float64]

CLIP: Array = np.array([constants.CLIP_X, constants.CLIP_Y])
"""``[2]`` metres per control step that an action of 1 commands."""

WORKSPACE_LOW: Array = np.array([constants.WORKSPACE_LOW_X, constants.WORKSPACE_LOW_Y])
WORKSPACE_HIGH: Array = np.array([constants.WORKSPACE_HIGH_X, constants.WORKSPACE_HIGH_Y])

SUBSTEP = 1.0 / float(constants.PHYSICS_RATE)
"""Seconds of one physics substep."""

SUBSTEPS = round(constants.PHYSICS_RATE / constants.CONTROL_RATE)
"""Physics substeps per control step."""

_STRIDE = float(constants.VELOCITY_LIMIT) * SUBSTEP
_KEPT = math.exp(-SUBSTEP / constants.SERVO_TIME_CONSTANT)
_SUBSTEP_ENDS = np.arange(SUBSTEPS + 1)
_DECAY: Array = np.array([_KEPT**count for count in range(SUBSTEPS + 1)])

GAIN = float(constants.EFFECTOR_MASS) / SUBSTEP
"""N s/m of the velocity actuator that corrects the arm's velocity within one substep."""


def clipped_action(displacement: Array) -> Array:
    """The robot's own clip: actions ``[..., 2]`` in [-1, 1] for wanted displacements ``[..., 2]`` in metres."""
    action: Array = np.clip(displacement / CLIP, -1.0, 1.0)
    return action


def target(effector: Array, action: Array) -> Array:
    """Targets of the servo ``[n, 2]``: the measured position plus the action's displacement, within the workspace."""
    goal: Array = np.clip(effector + action * CLIP, WORKSPACE_LOW, WORKSPACE_HIGH)
    return goal


def remaining_distance(distance: Array) -> Array:
    """Distances to the target ``[n, SUBSTEPS + 1]`` at every substep's end, from those at the start ``[n]``.

    Per substep the smaller of the two ways: ``velocity limit * dt``, or the first-order law's ``d (1 - exp(-dt/tau))``.
    """
    limited = np.ceil(distance / _STRIDE - 1.0 / (1.0 - _KEPT))
    limited = np.clip(limited, 0, SUBSTEPS).astype(np.intp)
    straight = np.minimum(_SUBSTEP_ENDS, limited[:, None])
    left: Array = (distance[:, None] - straight * _STRIDE) * _DECAY[_SUBSTEP_ENDS - straight]
    return left


def velocity_profile(effector: Array, goal: Array) -> Array:
    """The reference's velocity ``[n, SUBSTEPS, 2]`` in m/s from positions ``[n, 2]`` towards targets ``[n, 2]``."""
    way = goal - effector
    distance = np.sqrt(way[:, 0] * way[:, 0] + way[:, 1] * way[:, 1])
    remaining = remaining_distance(distance)
    share = (remaining[:, :-1] - remaining[:, 1:]) / np.maximum(distance, 1e-12)[:, None]
    profile: Array = way[:, None, :] * (share / SUBSTEP)[:, :, None]
    return profile


def overloaded(profile: Array, velocity: Array) -> NDArray[np.bool_]:
    """Emergency stop ``[n]``: within one control step, more force was asked of the arm, and for longer, than allowed.

    Turning round at full speed does that, and so does pressing on what does not give way; starting and stopping do not.

    Args:
        profile: ``[n, SUBSTEPS, 2]`` reference velocity in every substep.
        velocity: ``[n, SUBSTEPS, 2]`` the arm's velocity at every substep's start.
    """
    force = np.abs(profile - velocity) * GAIN
    overload = (force > float(constants.OVERLOAD_FORCE)).any(axis=2)
    stopped: NDArray[np.bool_] = overload.sum(axis=1) * SUBSTEP > float(constants.OVERLOAD_TIME)
    return stopped


class Rest:
    """Detection of rest for n effectors; a place is left once the effector is farther from it than the rest radius.

    A net displacement, not a speed: a policy that trembles on the spot is at rest, one that creeps on is not.

    Args:
        position: ``[n, 2]`` at first, in metres.
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
