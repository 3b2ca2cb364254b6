"""Evaluation of a method on a task: every episode from its own fixed start, in this process."""

from __future__ import annotations

import zlib
from typing import Any

import gymnasium
import torch

from lfobench.contract.method import Method
from lfobench.contract.suite import Task
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.rollout import EpisodeResults, rollout


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
        self._slots = seeds * episodes
        self._starts = [start_seed(task, episode) for episode in range(episodes)]
        self._environments: list[gymnasium.Env[Any, Any]] = []

    def evaluate(self, method: Method, device: torch.device) -> EpisodeResults:
        """K episodes per seed, in lock step."""
        while len(self._environments) < self._slots:
            self._environments.append(self._task.environment.make())
        return rollout(
            lambda observation: method.act(observation.to(device)).cpu(),
            self._transform,
            self._environments,
            self._starts,
        )

    def close(self) -> None:
        """Release the simulators."""
        for environment in self._environments:
            environment.close()
        self._environments = []
