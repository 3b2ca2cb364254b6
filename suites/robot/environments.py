"""The three Gymnasium environments: one world each, and n worlds in lock step as vector environments.

Gymnasium's own step limit reports no outcome: where `max_episode_steps` is not the task's, give `horizon` as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from lfobench.contract.episodes import BoolArray, FloatArray
from suites.robot import constants, tasks
from suites.robot.simulation import Simulation
from suites.robot.tasks import RobotTask

Array = NDArray[np.float64]
Stepped = tuple[FloatArray, Array, BoolArray, BoolArray, dict[str, Any]]

METADATA: dict[str, Any] = {"render_modes": [], "render_fps": int(constants.CONTROL_RATE)}

# A reading of the camera may lie a little off the table; bias and noise stay far below this.
_SLACK = 0.1


def action_space() -> Box:
    """Fractions ``[2]`` of the robot's clip."""
    return Box(-1.0, 1.0, (2,), np.float32)


def observation_space(task: RobotTask) -> Box:
    """Bounds of observations: the table for positions, the arm's limits for its velocity."""
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


class RobotEnvironment(gymnasium.Env[Any, Any]):
    """One world of a task.

    ``info`` of every reset and step holds the true positions: ``effector`` ``[2]`` and, where there is one, ``puck``
    ``[2]``; that of the last step, the ``outcome`` too.

    Args:
        task: the rules.
        horizon: steps after which an episode is cut; the task's own where None.
    """

    metadata = METADATA

    def __init__(self, task: RobotTask, horizon: int | None = None) -> None:
        self._simulation = Simulation(task, 1, horizon)
        self.action_space = action_space()
        self.observation_space = observation_space(task)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """A new episode; the seed alone decides it."""
        super().reset(seed=seed)
        world = int(self.np_random.integers(2**32)) if seed is None else seed
        return self._simulation.reset([world])[0], self._information()

    def step(self, action: NDArray[np.floating[Any]]) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """One control step.

        Raises:
            ValueError: where the action has a wrong size, is beyond [-1, 1] or is not a number.
        """
        wanted = np.asarray(action)
        if wanted.shape != (2,):
            raise ValueError(f"action has shape {wanted.shape}; it must be (2,)")
        stepped = self._simulation.step(wanted[None])
        information = self._information()
        if stepped.outcome[0] is not None:
            information["outcome"] = stepped.outcome[0]
        return (
            stepped.observation[0],
            float(stepped.reward[0]),
            bool(stepped.terminated[0]),
            bool(stepped.truncated[0]),
            information,
        )

    def _information(self) -> dict[str, Any]:
        puck = self._simulation.puck
        effector = {"effector": self._simulation.effector[0]}
        return effector if puck is None else {**effector, "puck": puck[0]}


class SafeManipulation(RobotEnvironment):
    """Rest above the bowl, touch no cup."""

    def __init__(self, embodiment: Literal["robot", "hand"] = "robot", horizon: int | None = None) -> None:
        super().__init__(tasks.SafeManipulation(embodiment), horizon)


class PuckStriking(RobotEnvironment):
    """Touch a puck at rest."""

    def __init__(self, horizon: int | None = None) -> None:
        super().__init__(tasks.PuckStriking(), horizon)


class DynamicHitting(RobotEnvironment):
    """Touch or hit a puck that slides down the table."""

    def __init__(self, score: Literal["touch", "hit"] = "touch", horizon: int | None = None) -> None:
        super().__init__(tasks.DynamicHitting(score), horizon)


class RobotVectorEnvironment(VectorEnv[FloatArray, FloatArray, NDArray[Any]]):
    """n worlds of a task in lock step, without autoreset; what a finished world returns means nothing.

    ``infos`` holds what the single environment's ``info`` does, with a row per world and, as in Gymnasium, a mask
    of the worlds that have the entry under the same name after an underscore.

    Args:
        task: the rules.
        num_envs: n.
        max_episode_steps: steps after which an episode is cut; the task's own where None.
    """

    def __init__(self, task: RobotTask, num_envs: int, max_episode_steps: int | None) -> None:
        self.metadata = {**METADATA, "autoreset_mode": AutoresetMode.DISABLED}
        self.num_envs = num_envs
        self._simulation = Simulation(task, num_envs, max_episode_steps)
        self.single_action_space = action_space()
        self.single_observation_space = observation_space(task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """New episodes in all worlds; world k of seed s starts like a single environment of seed s.

        Args:
            seed: one per world, or the first of consecutive ones.
            options: none are known; a part of the worlds cannot be reset.

        Raises:
            ValueError: where there is not one seed per world, or only some worlds should be reset.
        """
        if options and "reset_mask" in options:
            raise ValueError("options has 'reset_mask'; the worlds are in lock step, so all of them are reset")
        if seed is None:
            seed = [int(drawn) for drawn in self.np_random.integers(2**32, size=self.num_envs)]
        elif isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
            seed = [int(seed) + world for world in range(self.num_envs)]
        return self._simulation.reset(seed), self._information()

    def step(self, actions: NDArray[np.floating[Any]]) -> Stepped:
        """One control step of every world.

        Args:
            actions: ``[n, 2]`` in [-1, 1].

        Raises:
            ValueError: where an action has a wrong size, is beyond [-1, 1] or is not a number.
        """
        stepped = self._simulation.step(actions)
        information = self._information()
        if stepped.ended.any():
            information |= {"outcome": stepped.outcome, "_outcome": stepped.ended}
        return stepped.observation, stepped.reward, stepped.terminated, stepped.truncated, information

    def _information(self) -> dict[str, Any]:
        everywhere = np.ones(self.num_envs, dtype=np.bool_)
        information: dict[str, Any] = {"effector": self._simulation.effector, "_effector": everywhere}
        if (puck := self._simulation.puck) is not None:
            information |= {"puck": puck, "_puck": everywhere.copy()}
        return information


class VectorSafeManipulation(RobotVectorEnvironment):
    """Rest above the bowl, touch no cup."""

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        embodiment: Literal["robot", "hand"] = "robot",
    ) -> None:
        super().__init__(tasks.SafeManipulation(embodiment), num_envs, max_episode_steps)


class VectorPuckStriking(RobotVectorEnvironment):
    """Touch a puck at rest."""

    def __init__(self, num_envs: int = 1, max_episode_steps: int | None = None) -> None:
        super().__init__(tasks.PuckStriking(), num_envs, max_episode_steps)


class VectorDynamicHitting(RobotVectorEnvironment):
    """Touch or hit a puck that slides down the table."""

    def __init__(
        self, num_envs: int = 1, max_episode_steps: int | None = None, score: Literal["touch", "hit"] = "touch"
    ) -> None:
        super().__init__(tasks.DynamicHitting(score), num_envs, max_episode_steps)
