"""Recordings of scripted demonstrators: steps of n worlds in lock step, cut into episodes where each one stopped."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import Episodes, FloatArray
from lfobench.text import content_hash
from suites.robot import constants, tasks
from suites.robot.demonstrators.human_motion import PERIOD, Draws, Hand, Integers, Journey, Person
from suites.robot.servo import clipped_action
from suites.robot.simulation import Simulation

Names = NDArray[np.object_]
SUCCESS = tasks.OUTCOMES[tasks.SUCCESS]


def scored(outcome: Names, touched: NDArray[np.bool_], score: Literal["touch", "hit"]) -> Names:
    """Outcomes ``[n]`` under the task's own score, from those under the rules of a hit: a touch may be enough."""
    if score == "hit":
        return outcome
    judged = outcome.copy()
    judged[touched] = SUCCESS
    return judged


class Recording:
    """n recordings in lock step.

    Args:
        first: ``[n, obs]`` observations before the first step.
    """

    def __init__(self, first: FloatArray) -> None:
        self._observations = [first]
        self._actions: list[FloatArray] = []
        self._outcomes: list[Names] = []

    def add(self, action: NDArray[np.floating[Any]], observation: FloatArray, outcome: Names) -> None:
        """One step of all.

        Args:
            action: ``[n, act]``; NaN where there is none.
            observation: ``[n, obs]`` after it.
            outcome: ``[n]`` with which the rules would end an episode at this step, None where they would not.
        """
        self._actions.append(action.astype(np.float32))
        self._observations.append(observation)
        self._outcomes.append(outcome)

    def stopped(self, lengths: Integers) -> Take:
        """The first `lengths` ``[n]`` steps of each, as episodes."""
        length = lengths.astype(np.int64)
        table = np.stack(self._outcomes)
        ended = table.astype(np.bool_) & (np.arange(len(table))[:, None] < length)
        outcomes = table[ended.argmax(0), np.arange(len(length))]
        outcomes[~ended.any(0)] = None
        rewards = np.zeros(int(length.sum()), np.float32)
        rewards[np.cumsum(length) - 1] = outcomes == SUCCESS
        episodes = Episodes(
            observations=_cut(self._observations, length + 1),
            actions=_cut(self._actions, length),
            rewards=rewards,
            lengths=length,
            terminated=np.zeros(len(length), np.bool_),
        )
        return Take(episodes, outcomes)


@dataclass(frozen=True)
class Take:
    """A finished recording.

    Attributes:
        episodes: their last reward is 1 where the rules would have judged a success. None is terminated: the
            demonstrator stops the recording.
        outcomes: ``[n]`` with which the rules would first have ended each, None where they would not have.
    """

    episodes: Episodes
    outcomes: Names


def _cut(steps: list[FloatArray], lengths: Integers) -> FloatArray:
    """The first `lengths` ``[n]`` rows of each of n columns of steps ``[n, width]``, concatenated."""
    columns = np.stack(steps, axis=1)
    kept: FloatArray = columns[np.arange(columns.shape[1]) < lengths[:, None]]
    return kept


VERSION = 1
"""Part of the fingerprint; raised with every change of a recording that no field or constant of the robot shows."""


@dataclass(frozen=True)
class ScriptedDemonstrator(ABC):
    """A scripted demonstrator, whose fields decide its recordings."""

    @abstractmethod
    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings of that many episodes, with the outcomes under the rules.

        Every episode has random numbers of its own, so a longer recording begins with the shorter one.
        """

    @property
    def fingerprint(self) -> str:
        """Hash of the class, its fields and every constant of the simulated robot."""
        return content_hash(
            {
                "version": VERSION,
                "operator": type(self).__name__,
                "fields": asdict(self),
                "constants": {name: _plain(value) for name, value in vars(constants).items() if name.isupper()},
            }
        )

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        """Recordings of `episodes` episodes."""
        return self.perform(episodes, generator).episodes


def _plain(value: Any) -> Any:
    return float(value) if isinstance(value, float) else [_plain(each) for each in value]


def drag(simulation: Simulation, first: FloatArray, person: Person, way: Journey, draws: Draws, limit: int) -> Take:
    """Recordings of a journey that is planned before it begins.

    Args:
        simulation: just reset, with rules that end nothing.
        first: ``[n, obs]`` its first observations.
        person: model of the hand on the mouse.
        way: the journey.
        draws: the tremor's.
        limit: steps after which a recording is cut at the latest.
    """
    lengths = way.steps(limit)
    hand = Hand(person, simulation.effector, draws, limit, PERIOD)
    recording = Recording(first)
    for step in range(int(lengths.max())):
        mouse = hand.follow(way.intention.at((step + 1) * PERIOD))
        action = clipped_action(mouse - simulation.effector)
        result = simulation.step(action)
        recording.add(action, result.observation, result.outcome)
    return recording.stopped(lengths)
