"""Paths of the kitchen's scripted demonstrator, planned by inverse kinematics; standard output is the file.

``python -m tools.kitchen_plan > suites/franka/paths.safetensors``

Every sub-task has two paths: `do`, from a hub in front of the cupboards to beyond the sub-task's completion, and
`back`, from there to the hub. ``start`` leads from the episode's first position to the hub.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from suites.franka.constants import JOINTS, ROBOT
from suites.franka.environment import Kitchen

Vector = NDArray[np.float64]

LOWEST = np.array([-2.85, -1.74, -2.85, -3.0, -2.85, 0.02, -2.85])
HIGHEST = np.array([2.85, 1.74, 2.85, -0.45, 2.85, 2.05, 2.85])
"""Limits of the joints in radians, a little within those of the model and its controller."""
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
        """The solution, among those from random starts around `near`, with the smallest displacement of a joint.

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
        """Torques and forces ``[9]`` of the actuators against gravity, at rest in a position ``[9]``."""
        self._data.qpos[:ROBOT] = position
        self._data.qvel[:] = 0.0
        mujoco.mj_forward(self._model, self._data)
        needed: Vector = self._data.qfrc_bias[:ROBOT].copy()
        return needed


START = np.array([0.148, -1.768, 1.844, -2.477, 0.26, 0.713, 1.595, 0.04, 0.037])
HUB = np.array([-0.59, -1.34, 1.58, -2.37, 0.6, 1.14, 1.2, 0.04, 0.04])
OPEN, CLOSED, ON_HANDLE = 0.04, 0.0, 0.018
"""Position of either finger, metres; on the microwave's handle, which is thicker than that, they press."""

JOINT_STEP, LINE_STEP = 0.06, 0.012
"""Radians, or metres of the fingertips, between neighbouring points of a path."""

UPRIGHT, ON_ITS_SIDE = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
"""Directions of the gripper's first axis. On its side, the fingers lie above one another and bear a push sideways."""
POINTING = np.array([0.3, 1.0, -0.3])
"""Pointing a little down, as the sixth joint does not turn far enough to point level everywhere."""


class Draft:
    """A path as it grows: positions ``[n, 9]``, and what the fingers are commanded to at each of them."""

    def __init__(self, arm: Arm, start: Vector, up: Vector = UPRIGHT, command: float = OPEN) -> None:
        self._arm, self._up, self.points, self.fingers = arm, up, [start.copy()], [command]

    def to(self, joints: Vector, fingers: float) -> Draft:
        """Straight in joint space, the fingers moving at once."""
        here = self.points[-1]
        goal = np.concatenate((joints[:JOINTS], (fingers, fingers)))
        count = max(1, int(np.ceil(np.abs(goal - here)[:JOINTS].max() / JOINT_STEP)))
        for share in np.arange(1, count + 1) / count:
            point = here + (goal - here) * share
            point[JOINTS:] = fingers
            self._add(point, fingers)
        return self

    def line(self, target: Vector, forward: Vector, step: float = LINE_STEP) -> Draft:
        """The fingertips straight to a target."""
        tips, _ = self._arm.pose(self.points[-1])
        return self.along(lambda share: tips + (target - tips) * share, forward, step)

    def along(self, curve: Callable[[float], Vector], forward: Vector, step: float = LINE_STEP) -> Draft:
        """The fingertips along a curve over [0, 1], the gripper turning on the way to point `forward`."""
        here = self.points[-1]
        first = self._arm.pose(here)[1][:, 2]
        last = forward / np.linalg.norm(forward)
        length = sum(np.linalg.norm(curve((i + 1) / 20) - curve(i / 20)) for i in range(20))
        count = max(1, int(np.ceil(length / step)))
        for share in np.arange(1, count + 1) / count:
            pointing = first + (last - first) * share
            joints, error = self._arm.solve(curve(share), pointing, self._up, self.points[-1])
            if error > 0.006:
                raise ValueError(f"the arm cannot follow the path to {curve(share).round(3).tolist()}")
            self._add(np.concatenate((joints, here[JOINTS:])), self.fingers[-1])
        return self

    def grip(self, position: float, command: float, points: int = 5) -> Draft:
        """The fingers alone, as far as a position that the command may lie beyond."""
        here = self.points[-1]
        for share in np.arange(1, points + 1) / points:
            point = here.copy()
            point[JOINTS:] += (position - here[JOINTS:]) * share
            self._add(point, command)
        return self

    def commands(self) -> Vector:
        """Position commands ``[n, 9]`` that hold the arm in place; gravity bends a joint by load / stiffness."""
        held: Vector = np.stack([point + self._arm.load(point) / self._arm.stiffness for point in self.points])
        held[:, JOINTS:] = np.array(self.fingers)[:, None]
        return held

    def _add(self, point: Vector, command: float) -> None:
        self.points.append(point)
        self.fingers.append(command)


def microwave(arm: Arm) -> tuple[Draft, Draft]:
    """Grasp the upper half of the handle, pull it along its arc, let go."""
    hinge, radius, angle = np.array([-1.127, 0.456, 1.852]), 0.487, 0.0767
    inwards = 0.034 * np.array([-0.296, 0.955, 0.0])

    def handle(opened: float) -> Vector:
        at = angle - opened
        place: Vector = hinge + radius * np.array([np.cos(at), np.sin(at), 0.0])
        return place

    ahead = np.array([-0.1, 1.0, -0.3])
    inside = arm.search(handle(0.0) + inwards, ahead, UPRIGHT, HUB)
    before, _ = arm.solve(handle(0.0) - 4.0 * inwards, ahead, UPRIGHT, inside)
    do = Draft(arm, HUB).to(before, OPEN).line(handle(0.0) + inwards, ahead).grip(ON_HANDLE, CLOSED)
    do.along(lambda share: handle(0.8 * share) + inwards, np.array([-0.6, 1.0, -0.3]))
    back = Draft(arm, do.points[-1]).grip(OPEN, OPEN)
    back.line(handle(0.8) - 3.0 * inwards, np.array([-0.6, 1.0, -0.3])).to(HUB, CLOSED)
    return do, back


def kettle(arm: Arm) -> tuple[Draft, Draft]:
    """Push its body to the far burner with open fingers."""
    down = np.array([0.0, 0.8, -0.6])
    before = arm.search(np.array([-0.28, 0.15, 1.78]), down, UPRIGHT, HUB)
    do = Draft(arm, HUB).to(before, OPEN).line(np.array([-0.275, 0.19, 1.69]), down)
    do.line(np.array([-0.25, 0.55, 1.69]), np.array([0.2, 0.8, -0.6]))
    back = Draft(arm, do.points[-1]).line(np.array([-0.3, 0.35, 1.75]), down).to(HUB, CLOSED)
    return do, back


def light_switch(arm: Arm) -> tuple[Draft, Draft]:
    """Push the lever to the left."""
    return _push(arm, UPRIGHT, [(-0.31, 0.5, 2.28), (-0.315, 0.625, 2.275)], [(-0.47, 0.615, 2.275)])


def slide_cabinet(arm: Arm) -> tuple[Draft, Draft]:
    """Push the door's handle to the right."""
    return _push(arm, UPRIGHT, [(-0.2, 0.5, 2.5), (-0.185, 0.625, 2.5)], [(0.08, 0.62, 2.5)])


def bottom_burner(arm: Arm) -> tuple[Draft, Draft]:
    """Push the top of the lower knob to the right."""
    return _turn(arm, np.array([-0.256, 0.65, 2.226]), 0.034)


def top_burner(arm: Arm) -> tuple[Draft, Draft]:
    """The same with the upper knob, which has more free space above it."""
    return _turn(arm, np.array([-0.256, 0.65, 2.34]), 0.04)


def _turn(arm: Arm, knob: Vector, lever: float) -> tuple[Draft, Draft]:
    """Along the arc of the knob's top, with the fingers next to it."""

    def next_to_knob(angle: float) -> tuple[float, float, float]:
        sine, cosine = float(np.sin(angle)), float(np.cos(angle))
        return knob[0] + lever * sine - 0.028 * cosine, knob[1], knob[2] + lever * cosine + 0.028 * sine

    first, last = next_to_knob(-0.15), next_to_knob(1.5)
    entry = [(first[0] - 0.02, first[1] - 0.14, first[2] + 0.01), (first[0] - 0.015, first[1] - 0.03, first[2]), first]
    arc = [next_to_knob(angle) for angle in np.linspace(-0.15, 1.5, 6)[1:]]
    return _push(arm, ON_ITS_SIDE, entry, [*arc, (last[0] + 0.05, last[1], last[2])], 0.0045)


def _push(
    arm: Arm,
    up: Vector,
    entry: list[tuple[float, float, float]],
    push: list[tuple[float, float, float]],
    step: float = LINE_STEP,
) -> tuple[Draft, Draft]:
    """With closed fingers through points, and straight out again."""
    before = arm.search(np.array(entry[0]), POINTING, up, HUB)
    do = Draft(arm, HUB, up).to(before, OPEN).grip(CLOSED, CLOSED, 4)
    for point in entry[1:]:
        do.line(np.array(point), POINTING)
    for point in push:
        do.line(np.array(point), POINTING, step)
    out = np.array(push[-1]) - (0.0, 0.13, 0.0)
    return do, Draft(arm, do.points[-1], up, CLOSED).line(out, POINTING).to(HUB, CLOSED)


PLANS = {
    "microwave": microwave,
    "kettle": kettle,
    "light switch": light_switch,
    "slide cabinet": slide_cabinet,
    "bottom burner": bottom_burner,
    "top burner": top_burner,
}


def plan() -> dict[str, Vector]:
    """Positions and commands ``[n, 9]`` of every path, by ``<sub-task>/<do or back>/<positions or commands>``."""
    arm = Arm()
    drafts = {"start/back": Draft(arm, START).to(HUB, CLOSED)}
    for name, planned in PLANS.items():
        drafts[f"{name}/do"], drafts[f"{name}/back"] = planned(arm)
    tensors: dict[str, Vector] = {}
    for name, draft in drafts.items():
        tensors |= {f"{name}/positions": np.stack(draft.points), f"{name}/commands": draft.commands()}
    return tensors


if __name__ == "__main__":
    sys.stdout.buffer.write(save({name: tensor.astype(np.float32) for name, tensor in plan().items()}))
