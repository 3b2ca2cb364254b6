"""Evaluation: all seeds and episodes of a cell in lock step, every episode from its own fixed start."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

from lfobench.contract.method import Method
from lfobench.contract.suite import Task
from lfobench.data.mixing import ObservationTransform


@dataclass(frozen=True)
class EpisodeResults:
    """What S seeds did in K episodes each.

    Attributes:
        returns: raw returns ``[S, K]``.
        lengths: steps ``[S, K]``.
        finite: ``[S]``; False for a seed that answered a running episode with a non-finite action.
    """

    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    finite: NDArray[np.bool_]


def start_seed(task: Task, episode: int) -> int:
    """Seed of the reset of episode k: the same for every method, seed and step of a task (decision 7)."""
    return zlib.crc32(f"evaluation {task.name} {episode}".encode())


class Evaluator:
    """Runs a method's policies in the simulator.

    Args:
        task: names the environment and fixes the starts.
        transform: from the simulator's observation to the method's.
        seeds: length S of the seed axis.
        episodes: K per seed.
    """

    def __init__(self, task: Task, transform: ObservationTransform, seeds: int, episodes: int) -> None:
        self._task = task
        self._transform = transform
        self._seeds, self._episodes = seeds, episodes
        self._environments: list[gymnasium.Env[Any, Any]] = []

    def evaluate(self, method: Method, device: torch.device) -> EpisodeResults:
        """K episodes per seed; a finished episode's slot is kept, so shapes never depend on who falls first."""
        if not self._environments:
            self._environments = [self._task.environment.make() for _ in range(self._seeds * self._episodes)]
        slots = len(self._environments)
        raw = np.stack(
            [
                np.asarray(environment.reset(seed=start_seed(self._task, slot % self._episodes))[0], np.float32)
                for slot, environment in enumerate(self._environments)
            ]
        )
        returns, lengths = np.zeros(slots), np.zeros(slots, np.int64)
        running, finite = np.ones(slots, np.bool_), np.ones(slots, np.bool_)
        while running.any():
            observation = torch.from_numpy(self._transform(raw)).view(self._seeds, self._episodes, -1)
            action = method.act(observation.to(device)).cpu().numpy().reshape(slots, -1)
            # A diverged seed may answer NaN; the simulator must not see it.
            sound = np.isfinite(action)
            finite &= sound.all(-1) | ~running
            action = np.where(sound, action, 0.0)
            for slot in np.flatnonzero(running):
                raw[slot], reward, terminated, truncated, _ = self._environments[slot].step(action[slot])
                returns[slot] += float(reward)
                lengths[slot] += 1
                running[slot] = not (terminated or truncated)
        shape = (self._seeds, self._episodes)
        return EpisodeResults(returns.reshape(shape), lengths.reshape(shape), finite.reshape(shape).all(-1))

    def close(self) -> None:
        """Release the simulators."""
        for environment in self._environments:
            environment.close()
        self._environments = []
