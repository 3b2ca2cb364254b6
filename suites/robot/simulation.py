"""n worlds of one task in lock step: one control step of all of them is one call of the physics engine.

World k with seed s gives the same bits whatever n is and whatever the other worlds do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from lfobench.contract.episodes import BoolArray, FloatArray
from suites.robot import constants, model, servo, tasks
from suites.robot.servo import SUBSTEPS, Rest
from suites.robot.tasks import Codes, Motion, RobotTask, puck_met

Purpose = Literal["start", "bias", "noise", "dropout"]
PURPOSES: tuple[Purpose, ...] = ("start", "bias", "noise", "dropout")


def stream(seed: int, purpose: Purpose) -> np.random.Generator:
    """A generator of its own for every purpose, so that drawing more of one thing changes no other."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence((seed, PURPOSES.index(purpose)))))


SUBSTEPS_OF_LATENCY = round(constants.CAMERA_LATENCY * constants.PHYSICS_RATE / constants.CAMERA_RATE)
"""Physics substeps between the picture and the reading."""


def pictured(path: Array) -> Array:
    """Positions in the newest finished picture ``[n, 2]``, from those at the substeps' ends ``[n, SUBSTEPS, 2]``."""
    return path[:, SUBSTEPS - 1 - SUBSTEPS_OF_LATENCY]


class Camera:
    """Camera readings of n worlds: bias, noise and dropouts.

    Args:
        seeds: one per world.
        readings: how many per world can differ; later ones repeat the last one's error.
    """

    def __init__(self, seeds: Sequence[int], readings: int) -> None:
        bias = np.stack([stream(seed, "bias").standard_normal(2) for seed in seeds])
        noise = np.stack([stream(seed, "noise").standard_normal((readings, 2)) for seed in seeds], axis=1)
        self._error: Array = bias * constants.CAMERA_BIAS + noise * constants.CAMERA_NOISE
        lost = np.stack([stream(seed, "dropout").random(readings) for seed in seeds], axis=1) < constants.CAMERA_DROPOUT
        lost[0] = False
        self._lost = lost[:, :, None]
        self._next = 0
        self._held: Array = np.zeros((len(seeds), 2))

    def read(self, position: Array) -> Array:
        """The next reading ``[n, 2]`` of positions ``[n, 2]`` in the picture."""
        index = min(self._next, len(self._error) - 1)
        self._held = np.where(self._lost[index], self._held, position + self._error[index])
        self._next += 1
        return self._held


class Sensing:
    """Observations of n worlds of a task.

    Args:
        task: decides what is observed.
        camera: its camera, before the first reading.
    """

    def __init__(self, task: RobotTask, camera: Camera) -> None:
        self._task = task
        self._camera = camera
        self._relative: Array | None = None

    def observe(self, effector: Array, velocity: Array, pictured: Array | None) -> FloatArray:
        """The next observations ``[n, obs]``.

        Args:
            effector: ``[n, 2]`` true positions now.
            velocity: ``[n, 2]`` true velocities now.
            pictured: ``[n, 2]`` true positions, one frame ago, of what the camera tracks; None where it tracks nothing.
        """
        known = [effector] if pictured is None else [effector, self._camera.read(pictured)]
        if self._task.puck == "none":
            return known[-1].astype(np.float32)
        if self._task.puck == "resting":
            return np.concatenate(known, axis=1, dtype=np.float32)
        newest = known[1] - effector
        if self._relative is None:
            self._relative = np.tile(newest, int(constants.RELATIVE_POSITIONS))
        else:
            self._relative = np.concatenate((newest, self._relative[:, :-2]), axis=1)
        return np.concatenate((effector, velocity, self._relative), axis=1, dtype=np.float32)


Array = NDArray[np.float64]

ACTION_TOLERANCE = 1e-6
"""Tolerance beyond 1 for actions that were rounded."""


@dataclass(frozen=True)
class StepResult:
    """Result of a control step.

    Attributes:
        observation: ``[n, obs]``.
        reward: ``[n]``; 1 at the step at which an episode succeeds.
        terminated: ``[n]``; the rules have ended the episode, in this step or before.
        truncated: ``[n]``; time ran out, in this step or before.
        outcome: ``[n]`` the outcome's name at an episode's last step, else None.
        ended: ``[n]``; where `outcome` is not None.
    """

    observation: FloatArray
    reward: Array
    terminated: BoolArray
    truncated: BoolArray
    outcome: NDArray[np.object_]
    ended: BoolArray


class Simulation:
    """n worlds of one task.

    A finished world may be stepped further; it moves, but reports nothing more.

    Args:
        task: the rules.
        count: n.
        horizon: control steps after which an episode is cut; the task's own where None.
        ends: False lets every episode run to the horizon, for recording: nothing terminates, and `outcome` is,
            at every step, how the rules would have ended the episode there.
    """

    def __init__(self, task: RobotTask, count: int, horizon: int | None = None, *, ends: bool = True) -> None:
        if count < 1:
            raise ValueError(f"count is {count}; it must be at least 1")
        self.task = task
        self.count = count
        self.horizon = task.horizon if horizon is None else horizon
        if self.horizon < 1:
            raise ValueError(f"horizon is {self.horizon}; it must be at least 1")
        self._ends = ends
        self._model = model.build(task.effector_radius, task.puck)
        self._models = [self._model] * count
        self._data = [mujoco.MjData(self._model)]
        self._rollout = rollout.Rollout(nthread=0)
        axes = self._model.nq
        self._velocities = slice(1 + axes, 3 + axes)
        size = mujoco.mj_stateSize(self._model, model.STATE)
        self._state: Array = np.zeros((count, size))
        self._path: Array = np.empty((count, SUBSTEPS, size))
        self._sensors: Array = np.empty((count, SUBSTEPS, 0))
        self._step = -1
        self._touched = np.zeros(count, dtype=np.bool_)

    @property
    def effector(self) -> Array:
        """``[n, 2]`` true positions of the effector."""
        return self._state[:, 1:3].copy()

    @property
    def effector_velocity(self) -> Array:
        """``[n, 2]`` true velocities of the effector in m/s."""
        return self._state[:, self._velocities].copy()

    @property
    def puck(self) -> Array | None:
        """``[n, 2]`` true positions of the puck, where there is one."""
        return None if self.task.puck == "none" else self._state[:, 3:5].copy()

    @property
    def puck_velocity(self) -> Array | None:
        """``[n, 2]`` true velocities of the puck in m/s, where there is one."""
        return None if self.task.puck == "none" else self._state[:, 7:9].copy()

    @property
    def touched(self) -> BoolArray:
        """``[n]`` whether paddle and puck have met since the start."""
        return self._touched.copy()

    def reset(
        self,
        seeds: Sequence[int],
        effector: Array | None = None,
        puck: Array | None = None,
        puck_velocity: Array | None = None,
    ) -> FloatArray:
        """New episodes; their first observations ``[n, obs]``.

        Args:
            seeds: one per world, each at least 0.
            effector: ``[n, 2]`` starts in place of the task's own, which are drawn from the seeds.
            puck: the same for the puck.
            puck_velocity: the same for its velocity.

        Raises:
            ValueError: where `seeds` or a start has a wrong size, or a value that can be none.
        """
        if len(seeds) != self.count:
            raise ValueError(f"seeds has {len(seeds)} entries; there are {self.count} worlds")
        if min(seeds) < 0:
            raise ValueError(f"seeds has {min(seeds)}; a seed must be at least 0")
        starts = [self.task.start(stream(seed, "start")) for seed in seeds]
        self._state[:] = 0.0
        self._state[:, 1:3] = self._given("effector", effector, [start.effector for start in starts])
        if self.task.puck != "none":
            self._state[:, 3:5] = self._given("puck", puck, [start.puck for start in starts])
            velocities = [start.puck_velocity for start in starts]
            self._state[:, 7:9] = self._given("puck_velocity", puck_velocity, velocities)
        self._step = 0
        self._touched = np.zeros(self.count, dtype=np.bool_)
        self._terminated = np.zeros(self.count, dtype=np.bool_)
        self._rest = Rest(self.effector)
        self._truncated = np.zeros(self.count, dtype=np.bool_)
        self._sensing = Sensing(self.task, Camera(seeds, self.horizon + 1))
        return self._sensing.observe(self.effector, self.effector_velocity, self._tracked(self.effector, self.puck))

    def step(self, action: NDArray[np.floating[Any]]) -> StepResult:
        """One control step of every world.

        Args:
            action: ``[n, 2]`` in [-1, 1]; 1 commands the robot's clip, 0.26 m in x and 0.13 m in y.

        Raises:
            ValueError: where an action has a wrong size, is beyond [-1, 1] or is not a number.
        """
        if self._step < 0:
            raise ValueError("step() came before the first reset()")
        wanted = self._checked(action)
        start = self._state
        effector = start[:, 1:3]
        profile = servo.velocity_profile(effector, servo.target(effector, wanted))
        self._rollout.rollout(
            self._models,
            self._data,
            start,
            profile,
            control_spec=model.CONTROL,
            skip_checks=True,
            nstep=SUBSTEPS,
            state=self._path,
            sensordata=self._sensors,
        )
        path = self._path
        velocity = np.concatenate((start[:, None, self._velocities], path[:, :-1, self._velocities]), axis=1)
        stopped = servo.overloaded(profile, velocity)
        self._state = path[:, -1].copy()
        self._step += 1

        motion = self._motion(path)
        code = self.task.judge(motion)
        code[stopped & (code != tasks.CUP_HIT)] = tasks.EMERGENCY_STOP
        newest = self._tracked(motion.effector, motion.puck)
        observation = self._sensing.observe(
            self._state[:, 1:3],
            self._state[:, self._velocities],
            None if newest is None else pictured(newest),
        )
        return self._result(observation, code)

    def _tracked(self, effector: Array, puck: Array | None) -> Array | None:
        return effector if self.task.camera_tracks_effector else puck

    def _motion(self, path: Array) -> Motion:
        effector, puck, puck_velocity = path[:, :, 1:3], None, None
        touching = np.zeros(self.count, dtype=np.bool_)
        if self.task.puck != "none":
            puck, puck_velocity = path[:, :, 3:5], path[:, -1, 7:9]
            touching = puck_met(effector, puck)
            self._touched = self._touched | touching
        rested = self._rest.update(effector[:, -1].copy())
        return Motion(effector, puck, puck_velocity, rested, touching, self._touched)

    def _result(self, observation: FloatArray, code: Codes) -> StepResult:
        over = self._terminated | self._truncated
        code[over] = 0
        if self._ends:
            self._terminated = self._terminated | (code != 0)
        if self._step >= self.horizon:
            late = ~(over | self._terminated)
            self._truncated = self._truncated | late
            late &= code == 0
            code[late] = tasks.OUT_OF_TIME
            if self.task.touch_fails:
                code[late & self._touched] = tasks.TOUCHED_ONLY
        reward = (code == tasks.SUCCESS).astype(np.float64)
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        return StepResult(observation, reward, terminated, truncated, tasks.outcome_names(code), code != 0)

    def _given(self, name: str, value: Array | None, drawn: list[tuple[float, float]]) -> Array:
        chosen = np.asarray(drawn if value is None else value, dtype=np.float64)
        if chosen.shape != (self.count, 2) or not np.isfinite(chosen).all():
            raise ValueError(f"{name} has shape {chosen.shape}; it must be {self.count} finite pairs (x, y)")
        return chosen

    def _checked(self, action: NDArray[np.floating[Any]]) -> Array:
        wanted = np.asarray(action, dtype=np.float64)
        if wanted.shape != (self.count, 2):
            raise ValueError(f"action has shape {wanted.shape}; it must be {(self.count, 2)}")
        largest = np.abs(wanted).max()
        if not largest <= 1.0 + ACTION_TOLERANCE:
            cause = "has a value that is not a number" if np.isnan(largest) else f"reaches {largest:.6g}"
            raise ValueError(f"action {cause}; every entry must be in [-1, 1], a fraction of the robot's clip")
        return wanted
