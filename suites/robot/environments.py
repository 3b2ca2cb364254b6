"""The three Gymnasium environments, one world each.

Gymnasium's own limit on steps knows no outcome: where `max_episode_steps` is not the task's, give `horizon` as well.
"""

from __future__ import annotations

from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import FloatArray
from suites.robot import spaces, tasks
from suites.robot.simulation import Simulation
from suites.robot.tasks import RobotTask


class RobotEnvironment(gymnasium.Env[Any, Any]):
    """One world of a task.

    Every reset and step tells the true positions in ``info``: ``effector`` ``[2]`` and, where there is one, ``puck``
    ``[2]``; the last step tells the ``outcome`` too.

    Args:
        task: the rules.
        horizon: steps after which an episode is cut; the task's own where None.
    """

    metadata = spaces.METADATA

    def __init__(self, task: RobotTask, horizon: int | None = None) -> None:
        self._simulation = Simulation(task, 1, horizon)
        self.action_space = spaces.action_space()
        self.observation_space = spaces.observation_space(task)

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
    """Touch a puck that lies still."""

    def __init__(self, horizon: int | None = None) -> None:
        super().__init__(tasks.PuckStriking(), horizon)


class DynamicHitting(RobotEnvironment):
    """Meet a puck that slides down the table."""

    def __init__(self, score: Literal["touch", "hit"] = "touch", horizon: int | None = None) -> None:
        super().__init__(tasks.DynamicHitting(score), horizon)
