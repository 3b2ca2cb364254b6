"""What operators leave behind: steps of n worlds in lock step, cut into episodes where each operator stopped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import Episodes, FloatArray
from suites.robot import outcomes
from suites.robot.operators.draws import Integers

Names = NDArray[np.object_]
SUCCESS = outcomes.NAMES[outcomes.SUCCESS]


def scored(outcome: Names, touched: NDArray[np.bool_], score: Literal["touch", "hit"]) -> Names:
    """Outcomes ``[n]`` under the rules of a hit, as the task's own score has them: a touch may be enough."""
    if score == "hit":
        return outcome
    told = outcome.copy()
    told[touched] = SUCCESS
    return told


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
            action: ``[n, act]``; NaN where nothing was commanded.
            observation: ``[n, obs]`` after it.
            outcome: ``[n]`` how the rules would end an episode at this step, None where they would not.
        """
        self._actions.append(action.astype(np.float32))
        self._observations.append(observation)
        self._outcomes.append(outcome)

    def stopped(self, lengths: Integers) -> Take:
        """What the first `lengths` ``[n]`` steps of each hold."""
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
        episodes: their last reward is 1 where the rules would have called them a success. None is terminated: it is
            the operator who stops a recording.
        outcomes: ``[n]`` how the rules would first have ended each, None where they would not have.
    """

    episodes: Episodes
    outcomes: Names


def _cut(steps: list[FloatArray], lengths: Integers) -> FloatArray:
    """End to end, the first `lengths` ``[n]`` rows of each of n columns of steps ``[n, width]``."""
    columns = np.stack(steps, axis=1)
    kept: FloatArray = columns[np.arange(columns.shape[1]) < lengths[:, None]]
    return kept
