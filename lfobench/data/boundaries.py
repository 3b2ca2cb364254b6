"""Boundary rules by name: the rows that exist in the data, and their successors at the ends of episodes.

``released`` boundaries have the quirks of D4RL's loader, which the authors use: the last step of a timed-out episode
and the last row of a file are dropped, and the successor of a terminal step is the first observation of the next
episode (a cross-episode transition; termination ``teleport``). ``exact`` boundaries use the true successor of every
step.

Rows are indices into stacked observations; nothing is copied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lfobench.contract.episodes import BoolArray, Episodes, IntArray

if TYPE_CHECKING:
    from lfobench.contract.method import Termination  # torch, which reading a file can do without


@dataclass(frozen=True)
class Rows:
    """Transitions or triples as indices.

    Attributes:
        observation: ``[R]`` index of s.
        action: ``[R]`` index of a.
        next_observation: ``[R]`` index of s'.
        second_next_observation: ``[R]`` index of s''; None for plain transitions.
        terminated: ``[R]`` True where no value follows s'.
        sampled: rows that training draws; later ones only serve as discriminator negatives.
    """

    observation: IntArray
    action: IntArray
    next_observation: IntArray
    second_next_observation: IntArray | None
    terminated: BoolArray
    sampled: int

    def __len__(self) -> int:
        return len(self.observation)

    def first(self, count: int) -> Rows:
        """The first `count` sampled rows."""
        return self.at(np.arange(min(count, self.sampled)))

    def at(self, row: IntArray) -> Rows:
        """The rows `row` ``[n]``, in that order, all of them sampled."""
        second = self.second_next_observation
        return Rows(
            self.observation[row],
            self.action[row],
            self.next_observation[row],
            None if second is None else second[row],
            self.terminated[row],
            len(row),
        )

    def without_second(self) -> Rows:
        """The same rows as plain transitions."""
        return replace(self, second_next_observation=None)

    def shifted(self, observations: int, actions: int) -> Rows:
        """The same rows when `observations` and `actions` rows are stacked before theirs."""
        second = self.second_next_observation
        return Rows(
            self.observation + observations,
            self.action + actions,
            self.next_observation + observations,
            None if second is None else second + observations,
            self.terminated,
            self.sampled,
        )


def stack(parts: Sequence[Rows]) -> Rows:
    """Rows of all parts, in order; every part must be sampled whole."""
    seconds = [part.second_next_observation for part in parts]
    return Rows(
        np.concatenate([part.observation for part in parts]),
        np.concatenate([part.action for part in parts]),
        np.concatenate([part.next_observation for part in parts]),
        None if any(second is None for second in seconds) else np.concatenate([s for s in seconds if s is not None]),
        np.concatenate([part.terminated for part in parts]),
        sum(part.sampled for part in parts),
    )


def released_transitions(episodes: Episodes) -> Rows:
    """The Q-learning view of D4RL's reader: timed-out and final rows dropped, successors are the next raw row."""
    terminal = episodes.terminal_transition
    kept = ~(episodes.last_transition & ~terminal)
    kept[-1:] = False
    row = np.flatnonzero(kept)
    observation = episodes.observation_of_transition
    return Rows(observation[row], row, observation[row + 1], None, terminal[row], len(row))


def released_expert_prefix(expert: Rows, trajectories: int, horizon: int) -> Rows:
    """The expert rows that the released mix takes for K trajectories.

    A trajectory is counted when a step counter reaches `horizon` or at a terminal row; the row at which the K-th
    is counted is itself excluded. If K are never counted, every row is taken, as SMODICE's reader does; DILO's would
    silently take none, which no recipe means.
    """
    ends = np.flatnonzero(expert.terminated)
    starts = np.concatenate(([0], ends + 1))
    stops = np.concatenate((ends + 1, [len(expert)]))
    counted = [np.arange(start + horizon - 1, stop, horizon) for start, stop in zip(starts, stops, strict=True)]
    hits = np.union1d(np.concatenate(counted), ends)
    if trajectories < 1:
        return expert.first(0)
    return expert.first(int(hits[trajectories - 1]) if trajectories <= len(hits) else len(expert))


def released_triples(transitions: Rows) -> Rows:
    """Triples of successive rows: kept when row i+1 starts where row i ended and row i is not terminal.

    Row i+1 starts where row i ended exactly when the two indices agree, which replaces the authors' comparison
    of values. The last triple of a terminated episode is a cross-episode transition: it ends in the next one.
    """
    here, after = slice(None, -1), slice(1, None)
    kept = transitions.next_observation[here] == transitions.observation[after]
    kept &= ~transitions.terminated[here]
    row = np.flatnonzero(kept)
    return Rows(
        transitions.observation[row],
        transitions.action[row],
        transitions.next_observation[row],
        transitions.next_observation[row + 1],
        transitions.terminated[row],
        len(row),
    )


def exact_transitions(episodes: Episodes) -> Rows:
    """Every step with its true successor, where that is known."""
    row = np.flatnonzero(episodes.known[episodes.observation_of_transition + 1])
    observation = episodes.observation_of_transition[row]
    return Rows(observation, row, observation + 1, None, episodes.terminal_transition[row], len(row))


def triples_within(episodes: Episodes) -> Rows:
    """Every three successive observations of one episode that are known."""
    row = np.flatnonzero(~episodes.last_transition)
    row = row[episodes.known[episodes.observation_of_transition[row] + 2]]
    first = episodes.observation_of_transition[row]
    return Rows(first, row, first + 1, first + 2, np.zeros(len(row), np.bool_), len(row))


def exact_triples(episodes: Episodes, termination: Termination, absorbing: int) -> Rows:
    """Every three successive observations of one episode, and what `termination` adds at a terminal step.

    Nothing is added where the observation that an episode ends in is not known.

    ``zero`` adds (s_{T-1}, s_T, s_T) with d = 1. ``absorbing`` adds (s_{T-1}, s_T, abs), (s_T, abs, abs) and
    (abs, abs, abs), all with the terminal step's action: no action follows it.

    Args:
        episodes: the data.
        termination: ``zero`` or ``absorbing``.
        absorbing: index of the absorbing observation.
    """
    observation = episodes.observation_of_transition
    terminal = np.flatnonzero(episodes.terminal_transition & episodes.known[observation + 1])
    s, last = observation[terminal], observation[terminal] + 1
    within = triples_within(episodes)
    ends = len(terminal)
    if termination == "zero":
        return stack([within, Rows(s, terminal, last, last, np.ones(ends, np.bool_), ends)])
    absorbed, not_terminated = np.full(ends, absorbing), np.zeros(ends, np.bool_)
    return stack(
        [
            within,
            Rows(s, terminal, last, absorbed, not_terminated, ends),
            Rows(last, terminal, absorbed, absorbed, not_terminated, ends),
            Rows(absorbed, terminal, absorbed, absorbed, not_terminated, ends),
        ]
    )


def absorb_transitions(transitions: Rows, absorbing: int) -> Rows:
    """SMODICE's absorbing transitions: terminal rows lead to the absorbing observation, d = 1.

    One absorbing row per terminal row is appended and never drawn for training, as released.
    """
    terminal = np.flatnonzero(transitions.terminated)
    extra = np.full(len(terminal), absorbing)
    return Rows(
        np.concatenate((transitions.observation, extra)),
        np.concatenate((transitions.action, transitions.action[terminal])),
        np.concatenate((np.where(transitions.terminated, absorbing, transitions.next_observation), extra)),
        None,
        np.concatenate((transitions.terminated, np.ones(len(terminal), np.bool_))),
        transitions.sampled,
    )
