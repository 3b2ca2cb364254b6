"""Episodes: T+1 observations, T actions, T rewards and how each ended. Pairs and triples are index arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Episodes:
    """Episodes laid end to end.

    Attributes:
        observations: ``[N + E, obs]``; every episode of T steps owns T + 1 consecutive rows, the last of them NaN
            where the observation after the last step is not recorded.
        actions: ``[N, act]``.
        rewards: ``[N]``; for returns and manifests, no method ever sees them.
        lengths: ``[E]`` steps per episode.
        terminated: ``[E]``; True where the environment ended the episode, False where time ran out.
    """

    observations: FloatArray
    actions: FloatArray
    rewards: FloatArray
    lengths: IntArray
    terminated: BoolArray

    def __post_init__(self) -> None:
        transitions, episodes = int(self.lengths.sum()), len(self.lengths)
        shapes = {
            "observations": (self.observations.shape[0], transitions + episodes),
            "actions": (self.actions.shape[0], transitions),
            "rewards": (self.rewards.shape[0], transitions),
            "terminated": (self.terminated.shape[0], episodes),
        }
        for name, (found, expected) in shapes.items():
            if found != expected:
                raise ValueError(f"{name} has {found} rows; the episode lengths require {expected}")
        if episodes and int(self.lengths.min()) < 1:
            raise ValueError("an episode has no step")

    @property
    def transitions(self) -> int:
        """Number of steps in all episodes, N."""
        return len(self.actions)

    @cached_property
    def first_transition(self) -> IntArray:
        """``[E]`` index of every episode's first action."""
        return np.concatenate(([0], np.cumsum(self.lengths)[:-1])).astype(np.int64)

    @cached_property
    def first_observation(self) -> IntArray:
        """``[E]`` index of every episode's first observation."""
        return self.first_transition + np.arange(len(self.lengths))

    @cached_property
    def last_observation(self) -> IntArray:
        """``[E]`` index of the observation that every episode ends in."""
        return self.first_observation + self.lengths

    @cached_property
    def unknown_ends(self) -> BoolArray:
        """``[E]``; True where the observation that an episode ends in is not known."""
        unknown: BoolArray = np.isnan(self.observations[self.last_observation]).all(axis=1)
        return unknown

    @cached_property
    def known(self) -> BoolArray:
        """``[N + E]``; False for the last observation of an episode where it is not known."""
        known = np.ones(len(self.observations), np.bool_)
        known[self.last_observation[self.unknown_ends]] = False
        return known

    @cached_property
    def observation_of_transition(self) -> IntArray:
        """``[N]`` index of the observation in which every action was taken."""
        return np.arange(self.transitions) + np.repeat(np.arange(len(self.lengths)), self.lengths)

    @cached_property
    def last_transition(self) -> BoolArray:
        """``[N]``; True at the last step of an episode."""
        last = np.zeros(self.transitions, dtype=np.bool_)
        last[self.first_transition + self.lengths - 1] = True
        return last

    @cached_property
    def terminal_transition(self) -> BoolArray:
        """``[N]``; True at the last step of an episode that the environment ended."""
        return self.last_transition & np.repeat(self.terminated, self.lengths)

    def returns(self) -> NDArray[np.float64]:
        """``[E]`` undiscounted return of every episode."""
        return np.add.reduceat(self.rewards.astype(np.float64), self.first_transition)

    def episode(self, index: int) -> Episodes:
        """One of the episodes."""
        step, observation = self.first_transition[index], self.first_observation[index]
        length = self.lengths[index]
        return Episodes(
            self.observations[observation : observation + length + 1],
            self.actions[step : step + length],
            self.rewards[step : step + length],
            self.lengths[index : index + 1],
            self.terminated[index : index + 1],
        )

    def first_episodes(self, count: int) -> Episodes:
        """The first `count` whole episodes."""
        transitions = int(self.lengths[:count].sum())
        kept = min(count, len(self.lengths))
        return Episodes(
            self.observations[: transitions + kept],
            self.actions[:transitions],
            self.rewards[:transitions],
            self.lengths[:kept],
            self.terminated[:kept],
        )

    def first_transitions(self, count: int) -> Episodes:
        """Exactly the first `count` steps; an episode cut by the limit becomes a truncated one."""
        if count >= self.transitions:
            return self
        episodes = int(np.searchsorted(self.first_transition, count))
        lengths, terminated = self.lengths[:episodes].copy(), self.terminated[:episodes].copy()
        surplus = int(lengths.sum()) - count
        if surplus:
            lengths[-1] -= surplus
            terminated[-1] = False
        return Episodes(
            self.observations[: count + episodes], self.actions[:count], self.rewards[:count], lengths, terminated
        )


def concatenate(parts: Sequence[Episodes], observations: FloatArray | None = None) -> Episodes:
    """Episodes of all parts, in order; their observations in the given memory ``[N + E, obs]``, if any."""
    return Episodes(
        np.concatenate([part.observations for part in parts], out=observations),
        np.concatenate([part.actions for part in parts]),
        np.concatenate([part.rewards for part in parts]),
        np.concatenate([part.lengths for part in parts]),
        np.concatenate([part.terminated for part in parts]),
    )
