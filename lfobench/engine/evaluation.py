"""Evaluation of a method on a task: every episode from its own fixed start, in this process."""

from __future__ import annotations

import zlib

import torch

from lfobench.contract.method import Method
from lfobench.contract.suite import Task
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.rollout import EpisodeResults, rollout
from lfobench.engine.simulators import Simulators, simulators
from lfobench.plan.cells import Cell, Starts


def start_seed(task: Task, episode: int, starts: Starts = "evaluation") -> int:
    """Seed of the reset of episode k: the same for every method, seed and step of a task (decision 7)."""
    return zlib.crc32(f"{starts} {task.name} {episode}".encode())


class Evaluator:
    """Runs a method's policies in the simulator.

    Args:
        task: names the environment and fixes the starts.
        transform: from the simulator's observation to the method's.
        seeds: length S of the seed axis.
        episodes: which of the starts; K of them.
        starts: the tests', or those of a choice between trials.
    """

    def __init__(
        self,
        task: Task,
        transform: ObservationTransform,
        seeds: int,
        episodes: range,
        starts: Starts = "evaluation",
    ) -> None:
        self._environment = task.environment
        self._transform = transform
        self._slots = seeds * len(episodes)
        self._starts = [start_seed(task, episode, starts) for episode in episodes]
        self._simulators: Simulators | None = None

    def evaluate(self, method: Method, device: torch.device) -> EpisodeResults:
        """K episodes per seed, in lock step."""
        if self._simulators is None:
            self._simulators = simulators(self._environment, self._slots)
        return rollout(
            lambda observation: method.act(observation.to(device)).cpu(),
            self._transform,
            self._simulators,
            self._starts,
        )

    def close(self) -> None:
        """Release the simulators."""
        if self._simulators is not None:
            self._simulators.close()
        self._simulators = None


def fixed_starts(cell: Cell) -> range:
    """The fixed starts of every evaluation."""
    return range(cell.protocol.evaluation_episodes)


def further_starts(cell: Cell) -> range:
    """The starts from which the trained policy alone is run."""
    first = cell.protocol.evaluation_episodes
    return range(first, first + cell.protocol.further_episodes)
