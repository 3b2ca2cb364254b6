"""The rules of the readers once more: loops over raw rows that compare values, as the authors' readers do.

Slow, plain and independent of lfobench.data.boundaries; every observation of a test's episodes is distinct, so a
row can be recognised by its values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from lfobench.contract.episodes import Episodes
from lfobench.data.boundaries import Rows

Vector = tuple[float, ...]


@dataclass(frozen=True)
class Raw:
    """One row of a reader: values, not indices."""

    observation: Vector
    action: Vector
    next_observation: Vector
    terminal: bool
    second: Vector | None = None


def make_episodes(ends: Sequence[tuple[int, bool]], start: int = 0, width: int = 2) -> Episodes:
    """Episodes of the given (length, terminated), every observation and action unlike every other."""
    lengths = np.array([length for length, _ in ends], np.int64)
    steps, count = int(lengths.sum()), int(lengths.sum()) + len(ends)
    observation = start + np.arange(count, dtype=np.float32)
    action = -1.0 - start - np.arange(steps, dtype=np.float32)
    return Episodes(
        np.stack([observation * (k + 1) for k in range(width)], axis=1),
        action[:, None].copy(),
        np.arange(steps, dtype=np.float32) / 7.0,
        lengths,
        np.array([terminated for _, terminated in ends], np.bool_),
    )


def endings(minimum: int = 1, longest: int = 12) -> st.SearchStrategy[list[tuple[int, bool]]]:
    """Lengths and endings of some episodes."""
    return st.lists(st.tuples(st.integers(1, longest), st.booleans()), min_size=minimum, max_size=8)


def walk(episodes: Episodes) -> list[tuple[list[Vector], list[Vector], bool]]:
    """Every episode as its T + 1 observations, T actions and whether it was terminated."""
    found = []
    observation = action = 0
    for length, terminated in zip(episodes.lengths, episodes.terminated, strict=True):
        observations = [tuple(map(float, row)) for row in episodes.observations[observation : observation + length + 1]]
        actions = [tuple(map(float, row)) for row in episodes.actions[action : action + length]]
        found.append((observations, actions, bool(terminated)))
        observation, action = observation + length + 1, action + length
    return found


def q_learning_view(episodes: Episodes) -> list[Raw]:
    """The reader of 2.1 on a file that has a timeout array."""
    observations, actions, terminals, timeouts = [], [], [], []
    for states, moves, terminated in walk(episodes):
        for step, move in enumerate(moves):
            last = step == len(moves) - 1
            observations.append(states[step])
            actions.append(move)
            terminals.append(last and terminated)
            timeouts.append(last and not terminated)
    rows = []
    for i in range(len(observations) - 1):
        if timeouts[i]:
            continue
        rows.append(Raw(observations[i], actions[i], observations[i + 1], terminals[i]))
    return rows


def dilo_triples(rows: Sequence[Raw]) -> list[Raw]:
    """The loop of 2.2: a triple where the next row starts where this one ended, and this one is not terminal."""
    kept = []
    for i in range(len(rows) - 1):
        distance = np.linalg.norm(np.subtract(rows[i + 1].observation, rows[i].next_observation))
        if distance <= 1e-6 and not rows[i].terminal:
            row = rows[i]
            kept.append(
                Raw(row.observation, row.action, row.next_observation, row.terminal, rows[i + 1].next_observation)
            )
    return kept


def expert_rows_taken(rows: Sequence[Raw], trajectories: int, horizon: int) -> int:
    """The walk of 2.4: rows before the one at which the K-th trajectory is counted; all of them if it never is."""
    counted = counter = 0
    for i, row in enumerate(rows):
        counter += 1
        if counter == horizon or row.terminal:
            counted, counter = counted + 1, 0
            if counted == trajectories:
                return i
    return len(rows) if trajectories else 0


def released_mix(offline: Episodes, expert: Episodes, trajectories: int, horizon: int) -> list[Raw]:
    """Offline rows and the expert prefix, as 2.4 concatenates them."""
    rows = q_learning_view(expert)
    return q_learning_view(offline) + rows[: expert_rows_taken(rows, trajectories, horizon)]


def exact_triples(episodes: Episodes, mode: str) -> list[Raw]:
    """2.2's repaired modes, episode by episode; `mode` is ``zero`` or ``absorbing``."""
    rows = []
    for states, moves, terminated in walk(episodes):
        for t in range(len(moves) - 1):
            rows.append(Raw(states[t], moves[t], states[t + 1], False, states[t + 2]))
        if not terminated:
            continue
        before, end, move = states[-2], states[-1], moves[-1]
        nowhere = absorbing(len(end))
        if mode == "zero":
            rows.append(Raw(before, move, end, True, end))
        else:
            rows.append(Raw(before, move, end, False, nowhere))
            rows.append(Raw(end, move, nowhere, False, nowhere))
            rows.append(Raw(nowhere, move, nowhere, False, nowhere))
    if mode == "absorbing":
        return [with_indicator(row) for row in rows]
    return rows


def absorbing(width: int) -> Vector:
    """The absorbing observation, recognisable before the indicator is appended."""
    return (float("inf"),) * width


def with_indicator(row: Raw) -> Raw:
    """A trailing 0, or (0, ..., 0, 1) for the absorbing observation."""

    def append(state: Vector) -> Vector:
        return (*(0.0 for _ in state), 1.0) if state == absorbing(len(state)) else (*state, 0.0)

    second = None if row.second is None else append(row.second)
    return Raw(append(row.observation), row.action, append(row.next_observation), row.terminal, second)


def smodice_absorbing(rows: Sequence[Raw]) -> tuple[list[Raw], list[Raw]]:
    """2.6: the rows that are sampled, and the ones that are only appended."""
    width = len(rows[0].observation) if rows else 0
    nowhere = absorbing(width)
    sampled = [
        Raw(row.observation, row.action, nowhere if row.terminal else row.next_observation, row.terminal)
        for row in rows
    ]
    appended = [Raw(nowhere, row.action, nowhere, True) for row in rows if row.terminal]
    return [with_indicator(row) for row in sampled], [with_indicator(row) for row in appended]


def values(rows: Rows, observations: np.ndarray, actions: np.ndarray) -> list[Raw]:
    """Index rows of lfobench as values."""

    def vector(array: np.ndarray, index: int) -> Vector:
        return tuple(map(float, array[index]))

    second = rows.second_next_observation
    return [
        Raw(
            vector(observations, rows.observation[i]),
            vector(actions, rows.action[i]),
            vector(observations, rows.next_observation[i]),
            bool(rows.terminated[i]),
            None if second is None else vector(observations, second[i]),
        )
        for i in range(len(rows))
    ]


def sortable(rows: Sequence[Raw]) -> list[tuple[object, ...]]:
    """Rows in an order of their own, for comparing without regard to order."""
    return sorted((row.observation, row.action, row.next_observation, row.terminal, row.second or ()) for row in rows)
