"""Simulators in lock step: one environment after the other, or a vector environment that steps all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium
import numpy as np

from lfobench.contract.environment import ActionBox, Environment
from lfobench.contract.episodes import FloatArray


@dataclass(frozen=True)
class Stepped:
    """What one step of the running worlds gave, in the order in which they were named.

    Attributes:
        rewards: of each.
        over: whether its episode ended.
        outcomes: how it ended, where the environment says so; None otherwise.
    """

    rewards: Sequence[float]
    over: Sequence[bool]
    outcomes: Sequence[str | None]


class Simulators(Protocol):
    """A number of worlds, each with an episode of its own."""

    def __len__(self) -> int:
        """How many."""
        ...

    def reset(self, seeds: Sequence[int]) -> FloatArray:
        """Start an episode in every world; observations ``[n, obs]``."""
        ...

    def step(self, action: FloatArray, running: Sequence[int], observation: FloatArray) -> Stepped:
        """Step the worlds `running` with their rows of `action` ``[n, act]``; their rows of `observation` change.

        Actions are a method's, in [-1, 1].
        """
        ...

    def close(self) -> None:
        """Release them."""
        ...


def simulators(environment: Environment, count: int) -> Simulators:
    """`count` worlds of an environment: as a vector environment where it has that form."""
    together = environment.make_many(count)
    return OneByOne([environment.make() for _ in range(count)]) if together is None else Together(together)


class OneByOne:
    """Environments that step in turn."""

    def __init__(self, environments: Sequence[gymnasium.Env[Any, Any]]) -> None:
        self._environments = environments
        self._steps = [environment.step for environment in environments]
        self._box = ActionBox.of(environments[0].action_space)

    def __len__(self) -> int:
        return len(self._environments)

    def reset(self, seeds: Sequence[int]) -> FloatArray:
        """See `Simulators`."""
        starts = zip(self._environments, seeds, strict=True)
        return np.stack([np.asarray(world.reset(seed=seed)[0], np.float32) for world, seed in starts])

    def step(self, action: FloatArray, running: Sequence[int], observation: FloatArray) -> Stepped:
        """See `Simulators`."""
        # Lists, because NumPy charges for every element that is read or written on its own.
        rewards, over, outcomes = [], [], []
        action = self._box.in_units(action)
        for world in running:
            observation[world], reward, terminated, truncated, info = self._steps[world](action[world])
            rewards.append(float(reward))
            over.append(bool(terminated or truncated))
            outcomes.append(info.get("outcome") if over[-1] else None)
        return Stepped(rewards, over, outcomes)

    def close(self) -> None:
        """See `Simulators`."""
        for environment in self._environments:
            environment.close()


class Together:
    """A vector environment that leaves a finished world alone until all are reset."""

    def __init__(self, environment: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        self._environment = environment
        self._box = ActionBox.of(environment.single_action_space)

    def __len__(self) -> int:
        return self._environment.num_envs

    def reset(self, seeds: Sequence[int]) -> FloatArray:
        """See `Simulators`."""
        observation, _ = self._environment.reset(seed=list(seeds))  # type: ignore[arg-type]  # one per world, as SyncVectorEnv takes them
        return np.array(observation, np.float32)

    def step(self, action: FloatArray, running: Sequence[int], observation: FloatArray) -> Stepped:
        """See `Simulators`."""
        found, rewards, terminated, truncated, info = self._environment.step(self._box.in_units(action))
        observation[running] = np.asarray(found, np.float32)[running]
        over = np.logical_or(terminated, truncated)[running]
        outcomes: Sequence[str | None] = [None] * len(running)
        if "outcome" in info and over.any():
            known = info["_outcome"][running] & over
            outcomes = [str(what) if said else None for what, said in zip(info["outcome"][running], known, strict=True)]
        return Stepped(np.asarray(rewards)[running].tolist(), over.tolist(), outcomes)

    def close(self) -> None:
        """See `Simulators`."""
        self._environment.close()
