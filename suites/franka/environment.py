"""gymnasium-robotics' ``FrankaKitchen-v1`` as D4RL scores it, with one flat observation.

Both have in common: the arm with velocity commands at 12.5 Hz, the start, the sub-tasks' goals, a reward of one
for every scored sub-task that a step completes for the first time, and an end once all four are completed. So a return
counts sub-tasks, from 0 to 4. They differ in the dynamics of arm, doors and knobs: gymnasium-robotics' model is
a newer one, and nothing of D4RL's was replayed in it. And it judges a sub-task by an object's position, D4RL by the
reading of its noisy sensors, which differs by less than a tenth of the threshold.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import FloatArray
from suites.franka import constants
from suites.franka.constants import Layout, Variant
from suites.robotics import imported

SIZES: dict[Layout, int] = {"d4rl-with-goal": 60, "d4rl-without-goal": 30, "minari": 59}


class Kitchen(gymnasium.Env[FloatArray, NDArray[np.floating[Any]]]):
    """A robot arm in a kitchen.

    The layouts of an observation:

    - ``d4rl-with-goal`` ``[60]``: 9 coordinates of the robot, 21 of the objects, both with D4RL's noise, and the 30 of
      the variant's goal. The kitchen goal-vector trap: D4RL's files hold the goal of the variant that each was made
      for, so the expert rows of ``complete`` differ from every row of ``mixed`` by a constant vector, which
      identifies the expert; and a policy gets the goal of the variant it is evaluated in.
    - ``d4rl-without-goal`` ``[30]``: the same without the goal. Of a file, read the first 30 columns.
    - ``minari`` ``[59]``: gymnasium-robotics' own: coordinates and velocities of the robot (9, 9) and of the objects
      (21, 20), with that environment's lesser noise and no goal.

    ``info`` of every reset and step holds ``completed``: names of the scored sub-tasks that are, in order.

    Args:
        variant: D4RL's name for which four sub-tasks are scored.
        layout: of the observation.

    Attributes:
        model: MuJoCo's.
        data: MuJoCo's, with the true state.

    Raises:
        ValueError: for another variant or layout.
        UserError: where gymnasium-robotics is not installed.
    """

    def __init__(self, variant: Variant = "partial", layout: Layout = "d4rl-with-goal") -> None:
        if variant not in constants.SUB_TASKS or layout not in SIZES:
            raise ValueError(
                f"variant {variant!r} with layout {layout!r}: a variant is one of {', '.join(constants.SUB_TASKS)}, "
                f"a layout one of {', '.join(SIZES)}"
            )
        self._noisy = layout != "minari"
        self._tail = constants.goal(variant) if layout == "d4rl-with-goal" else np.empty(0, np.float32)
        noise = {"robot_noise_ratio": constants.NOISE_RATIO, "object_noise_ratio": 0.0} if self._noisy else {}
        self._kitchen = imported("franka_kitchen", "kitchen").KitchenEnv(
            tasks_to_complete=list(constants.SUB_TASKS[variant]), **noise
        )
        self.model, self.data = self._kitchen.model, self._kitchen.data
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (SIZES[layout],), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (constants.ROBOT,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """A new episode from D4RL's one start; the seed decides the noise."""
        super().reset(seed=seed)
        observation, information = self._kitchen.reset(seed=int(self.np_random.integers(2**31)))
        return self._observation(observation["observation"]), _completed(information)

    def step(self, action: NDArray[np.floating[Any]]) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Velocities ``[9]`` for 0.08 s: 1 is 2 rad/s, or 2 m/s of a finger; what is beyond [-1, 1] is clipped."""
        observation, reward, terminated, _, information = self._kitchen.step(np.asarray(action, np.float64))
        flat = self._observation(observation["observation"])
        return flat, float(reward), bool(terminated), False, _completed(information)

    def close(self) -> None:
        """Release the simulator."""
        self._kitchen.close()

    def _observation(self, full: NDArray[np.float64]) -> FloatArray:
        """``[59]`` as the simulator gives it to ``[obs]``."""
        if not self._noisy:
            return full.astype(np.float32)
        robot, objects = full[: constants.ROBOT], full[2 * constants.ROBOT :][: constants.OBJECTS]
        noise = self.np_random.uniform(-1.0, 1.0, constants.OBJECTS) * constants.OBJECT_NOISE
        objects = objects + constants.NOISE_RATIO * noise
        return np.concatenate((robot.astype(np.float32), objects.astype(np.float32), self._tail))


def _completed(information: dict[str, Any]) -> dict[str, Any]:
    return {"completed": tuple(information["episode_task_completions"])}
