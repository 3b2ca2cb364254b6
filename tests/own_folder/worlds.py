"""A cart on a line, with whatever spaces it is asked for: the neighbour of a suite that is given by path."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv

OBSERVATIONS: dict[str, spaces.Space[Any]] = {
    "flat": spaces.Box(-np.inf, np.inf, (2,), np.float32),
    "dict": spaces.Dict({"place": spaces.Box(-1.0, 1.0, (2,), np.float32)}),
    "image": spaces.Box(0, 255, (8, 8, 3), np.uint8),
    "discrete": spaces.Discrete(3),
    "tuple": spaces.Tuple([spaces.Discrete(3)]),
    "scalar": spaces.Box(-1.0, 1.0, (), np.float32),
}


def actions_of(name: str) -> spaces.Space[Any]:
    """``[-2, 2]`` where it is named so; other kinds by their name."""
    boxes = {
        "two": ([-2.0], [2.0]),
        "one": ([-1.0], [1.0]),
        "skew": ([0.0, -3.0], [1.0, 1.0]),
        "unbounded": ([-np.inf], [np.inf]),
        "half": ([0.0, -2.0], [np.inf, 2.0]),
    }
    if name in boxes:
        low, high = boxes[name]
        return spaces.Box(np.array(low, np.float32), np.array(high, np.float32))
    return {
        "discrete": spaces.Discrete(2),
        "multidiscrete": spaces.MultiDiscrete([2, 3]),
        "dict": spaces.Dict({"push": spaces.Box(-1.0, 1.0, (1,), np.float32)}),
        "whole": spaces.Box(-1, 1, (1,), np.int64),
        "grid": spaces.Box(-1.0, 1.0, (2, 2), np.float32),
    }[name]


class Cart(gymnasium.Env[Any, Any]):
    """Its reward is the sum of the action, in its own units."""

    def __init__(self, actions: str = "two", observations: str = "flat") -> None:
        self.action_space = actions_of(actions)
        self.observation_space = OBSERVATIONS[observations]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._place = self.np_random.uniform(-1.0, 1.0)
        return self._observed(0.0), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert self.action_space.contains(np.asarray(action, np.float32)), action
        push = float(np.sum(action))
        self._place += 0.01 * push
        return self._observed(push), push, False, False, {}

    def _observed(self, push: float) -> Any:
        return np.array([self._place, push], np.float32)


class Carts(VectorEnv[Any, Any, Any]):
    """Many of them, with a scene."""

    metadata: ClassVar[dict[str, Any]] = {"autoreset_mode": AutoresetMode.DISABLED}

    def __init__(self, num_envs: int, actions: str, observations: str, max_episode_steps: int) -> None:
        self.num_envs, self._most = num_envs, max_episode_steps
        self.single_observation_space, self.single_action_space = OBSERVATIONS[observations], actions_of(actions)

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        self._place, self._time = np.zeros((self.num_envs, 2), np.float32), 0
        return self._place.copy(), {"effector": self._place.copy()}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        push = np.asarray(actions).sum(-1)
        self._place = self._place + np.stack((push, push), 1).astype(np.float32)
        self._time += 1
        over = np.full(self.num_envs, self._time >= self._most)
        info = {"effector": self._place.copy(), "outcome": np.array(["success"] * self.num_envs), "_outcome": over}
        return self._place.copy(), push, np.zeros(self.num_envs, bool), over, info


gymnasium.register("Cart-v0", entry_point="worlds:Cart")
gymnasium.register("Carts-v0", entry_point="worlds:Cart", vector_entry_point="worlds:Carts")
