"""The three environments as Gymnasium vector environments: n worlds of one simulation, in lock step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from lfobench.contract.episodes import BoolArray, FloatArray
from suites.robot import spaces, tasks
from suites.robot.simulation import Simulation
from suites.robot.tasks import RobotTask

Array = NDArray[np.float64]
Stepped = tuple[FloatArray, Array, BoolArray, BoolArray, dict[str, Any]]


class RobotVectorEnvironment(VectorEnv[FloatArray, FloatArray, NDArray[Any]]):
    """n worlds of a task. None is reset by itself; a finished one may be stepped on, and then means nothing.

    ``infos`` holds what the single environment's ``info`` does, with a row per world and, as is Gymnasium's custom, a
    mask of the worlds that it is told of under the same name after an underscore.

    Args:
        task: the rules.
        num_envs: n.
        max_episode_steps: steps after which an episode is cut; the task's own where None.
    """

    def __init__(self, task: RobotTask, num_envs: int, max_episode_steps: int | None) -> None:
        self.metadata = {**spaces.METADATA, "autoreset_mode": AutoresetMode.DISABLED}
        self.num_envs = num_envs
        self._simulation = Simulation(task, num_envs, max_episode_steps)
        self.single_action_space = spaces.action_space()
        self.single_observation_space = spaces.observation_space(task)
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
        if stepped.told.any():
            information |= {"outcome": stepped.outcome, "_outcome": stepped.told}
        return stepped.observation, stepped.reward, stepped.terminated, stepped.truncated, information

    def _information(self) -> dict[str, Any]:
        everywhere = np.ones(self.num_envs, dtype=np.bool_)
        information: dict[str, Any] = {"effector": self._simulation.effector, "_effector": everywhere}
        if (puck := self._simulation.puck) is not None:
            information |= {"puck": puck, "_puck": everywhere.copy()}
        return information


class SafeManipulation(RobotVectorEnvironment):
    """Rest above the bowl, touch no cup."""

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        embodiment: Literal["robot", "hand"] = "robot",
    ) -> None:
        super().__init__(tasks.SafeManipulation(embodiment), num_envs, max_episode_steps)


class PuckStriking(RobotVectorEnvironment):
    """Touch a puck that lies still."""

    def __init__(self, num_envs: int = 1, max_episode_steps: int | None = None) -> None:
        super().__init__(tasks.PuckStriking(), num_envs, max_episode_steps)


class DynamicHitting(RobotVectorEnvironment):
    """Meet a puck that slides down the table."""

    def __init__(
        self, num_envs: int = 1, max_episode_steps: int | None = None, score: Literal["touch", "hit"] = "touch"
    ) -> None:
        super().__init__(tasks.DynamicHitting(score), num_envs, max_episode_steps)
