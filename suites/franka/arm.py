"""The arm's geometry: where its fingertips are, which joint angles put them somewhere, what gravity does to them."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from suites.franka.constants import JOINTS, ROBOT
from suites.franka.environment import Kitchen

Vector = NDArray[np.float64]

LOWEST = np.array([-2.85, -1.74, -2.85, -3.0, -2.85, 0.02, -2.85])
HIGHEST = np.array([2.85, 1.74, 2.85, -0.45, 2.85, 2.05, 2.85])
"""Of the joints, radians, a little within what both the model and its controller allow."""
BEYOND_SITE = 0.043
"""Metres from the model's site ``end_effector`` to between the fingertips."""

FORWARD_WEIGHT, UP_WEIGHT = 0.3, 0.1
"""Metres of error in position that weigh as much as a radian of error in pointing and in roll."""
DAMPING, LARGEST_STEP = 1e-4, 0.1
ACCURATE = 0.004
"""Metres from the target at which a solution counts."""


class Arm:
    """Kinematics of the arm in the kitchen's model."""

    def __init__(self) -> None:
        kitchen = Kitchen()
        self._model = kitchen.model
        self._data = mujoco.MjData(self._model)
        self._site = self._model.site("end_effector").id
        kitchen.close()
        self.stiffness: Vector = self._model.actuator_gainprm[:ROBOT, 0].copy()
        """``[9]`` torque, or force, per radian, or metre, between a commanded and the actual position."""

    def pose(self, joints: Vector) -> tuple[Vector, Vector]:
        """The fingertips ``[3]`` and the gripper's axes ``[3, 3]`` (up, sideways, forward in columns)."""
        self._data.qpos[:JOINTS] = joints[:JOINTS]
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        axes = self._data.site_xmat[self._site].reshape(3, 3).copy()
        return self._data.site_xpos[self._site] + BEYOND_SITE * axes[:, 2], axes

    def solve(
        self, target: Vector, forward: Vector, up: Vector, near: Vector, steps: int = 200
    ) -> tuple[Vector, float]:
        """Joints ``[7]`` close to `near` that put the fingertips at a target, and the error that is left, in metres.

        Damped least squares on the geometric Jacobian (Wampler 1986; Nakamura and Hanafusa 1986); pointing `forward`
        with the gripper's first axis towards `up` is wanted too, with lesser weights.
        """
        joints = near[:JOINTS].copy()
        forward = forward / np.linalg.norm(forward)
        moving, turning = np.zeros((2, 3, self._model.nv))
        for _ in range(steps):
            tips, axes = self.pose(joints)
            body = self._model.site_bodyid[self._site]
            mujoco.mj_jac(self._model, self._data, moving, turning, tips, body)
            across = up - (up @ axes[:, 2]) * axes[:, 2]
            across /= np.linalg.norm(across)
            turn = turning[:, :JOINTS]
            jacobian = np.vstack((moving[:, :JOINTS], FORWARD_WEIGHT * turn, UP_WEIGHT * turn))
            error = np.concatenate(
                (
                    target - tips,
                    FORWARD_WEIGHT * np.cross(axes[:, 2], forward),
                    UP_WEIGHT * np.cross(axes[:, 0], across),
                )
            )
            step = np.linalg.solve(jacobian.T @ jacobian + DAMPING * np.eye(JOINTS), jacobian.T @ error)
            joints = np.clip(joints + np.clip(step, -LARGEST_STEP, LARGEST_STEP), LOWEST, HIGHEST)
            if np.abs(step).max() < 1e-5:
                break
        return joints, float(np.linalg.norm(target - self.pose(joints)[0]))

    def search(self, target: Vector, forward: Vector, up: Vector, near: Vector, tries: int = 16) -> Vector:
        """Of the solutions from random starts around `near`, the one that turns no joint far from it.

        Raises:
            ValueError: where the target is out of reach.
        """
        generator = np.random.default_rng(0)
        best: tuple[float, Vector] | None = None
        for attempt in range(tries):
            start = near[:JOINTS] + (generator.normal(0.0, 0.5, JOINTS) if attempt else 0.0)
            joints, error = self.solve(target, forward, up, np.clip(start, LOWEST, HIGHEST))
            away = np.abs(joints - near[:JOINTS])
            cost = float(away.max() + 0.3 * np.linalg.norm(away))
            if error < ACCURATE and (best is None or cost < best[0]):
                best = cost, joints
        if best is None:
            raise ValueError(f"the arm cannot reach {target.round(3).tolist()}")
        return best[1]

    def load(self, position: Vector) -> Vector:
        """Torques and forces ``[9]`` that gravity asks of the actuators at rest in a position ``[9]``."""
        self._data.qpos[:ROBOT] = position
        self._data.qvel[:] = 0.0
        mujoco.mj_forward(self._model, self._data)
        needed: Vector = self._data.qfrc_bias[:ROBOT].copy()
        return needed
