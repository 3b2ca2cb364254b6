"""The three environments: gymnasium-robotics' simulation with D4RL's rewards and ends of episodes.

gymnasium-robotics differs in this: its door and hammer reward a palm that is far from its object, where D4RL rewards
one that is near, and its pen goes on for 200 steps after a drop. Observations, actions, starts and ``info["success"]``
are the same. Success is that of a step; an episode counts as successful where one of its steps is. ``info`` has no
``outcome``: the score is a normalised return, and records with outcomes would be shown as counts of successes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, SupportsFloat

import gymnasium

from suites.hand import rewards
from suites.robotics import imported

Judgement = tuple[float, bool]
"""Reward of a step, and whether it ended the episode."""


class HandEnvironment(gymnasium.Wrapper[Any, Any, Any, Any]):
    """A simulation of gymnasium-robotics with other rewards and ends.

    Args:
        simulation: with its arena and its starts.
        judge: reward and end of a step, from the simulation after it.
    """

    def __init__(self, simulation: gymnasium.Env[Any, Any], judge: Callable[[Any], Judgement]) -> None:
        super().__init__(simulation)
        self._judge = judge

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """One control step of 5 physics steps."""
        # Its reward and end are replaced, and it never truncates: the time limit around this environment does.
        observation, _, _, _, information = self.env.step(action)
        reward, terminated = self._judge(self.unwrapped)
        return observation, reward, terminated, False, {"success": bool(information["success"])}


def pen(**arguments: Any) -> HandEnvironment:
    """Turn a pen in the hand to a random direction; ends when it drops."""

    def judge(simulation: Any) -> Judgement:
        data = simulation.data
        position = data.body("Object").xpos
        direction = (data.site("object_top").xpos - data.site("object_bottom").xpos) / simulation.pen_length
        wanted = (data.site("target_top").xpos - data.site("target_bottom").xpos) / simulation.tar_length
        return rewards.pen(position, data.site("eps_ball").xpos, direction, wanted), rewards.dropped(position)

    return HandEnvironment(_simulation("pen", arguments), judge)


def door(**arguments: Any) -> HandEnvironment:
    """Undo the latch of a door at a random place, and open it."""

    def judge(simulation: Any) -> Judgement:
        data = simulation.data
        palm, handle = data.site("S_grasp").xpos, data.site("S_handle").xpos
        return rewards.door(palm, handle, float(data.joint("door_hinge").qpos[0]), data.qvel), False

    return HandEnvironment(_simulation("door", arguments), judge)


def hammer(**arguments: Any) -> HandEnvironment:
    """Take a hammer and drive a nail into a board at a random height."""

    def judge(simulation: Any) -> Judgement:
        data = simulation.data
        palm, handle, head = data.site("S_grasp").xpos, data.body("Object").xpos, data.site("tool").xpos
        nail, goal = data.site("S_target").xpos, data.site("nail_goal").xpos
        return rewards.hammer(palm, handle, head, nail, goal, data.qvel), False

    return HandEnvironment(_simulation("hammer", arguments), judge)


def _simulation(name: str, arguments: dict[str, Any]) -> gymnasium.Env[Any, Any]:
    module = imported(f"adroit_hand.adroit_{name}", "adroit")
    made: gymnasium.Env[Any, Any] = getattr(module, f"AdroitHand{name.capitalize()}Env")(**arguments)
    return made
