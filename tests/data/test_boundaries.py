"""Rows by index against the readers' loops over values (raw_rows.py)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from raw_rows import (
    dilo_triples,
    endings,
    exact_triples,
    expert_rows_taken,
    make_episodes,
    q_learning_view,
    values,
    walk,
)

from lfobench.data import boundaries

Ends = list[tuple[int, bool]]


@given(endings())
def test_released_transitions_are_the_readers(ends: Ends) -> None:
    episodes = make_episodes(ends)
    rows = boundaries.released_transitions(episodes)
    assert values(rows, episodes.observations, episodes.actions) == q_learning_view(episodes)
    assert rows.sampled == len(rows)


@given(endings())
def test_released_triples_are_the_authors_loop(ends: Ends) -> None:
    episodes = make_episodes(ends)
    rows = boundaries.released_triples(boundaries.released_transitions(episodes))
    assert values(rows, episodes.observations, episodes.actions) == dilo_triples(q_learning_view(episodes))
    assert not rows.terminated.any(), "the (1 - d) of the released loss is dead code"


@given(endings(), st.integers(0, 6), st.integers(1, 14))
def test_released_prefix_is_the_authors_walk(ends: Ends, trajectories: int, horizon: int) -> None:
    rows = boundaries.released_transitions(make_episodes(ends))
    taken = boundaries.released_expert_prefix(rows, trajectories, horizon)
    assert len(taken) == expert_rows_taken(q_learning_view(make_episodes(ends)), trajectories, horizon)
    assert taken.observation.tolist() == rows.observation[: len(taken)].tolist()


@pytest.mark.parametrize("length", [1000, 200, 100, 3])
def test_an_episode_cut_by_time_has_two_triples_less_than_steps(length: int) -> None:
    rows = boundaries.released_triples(boundaries.released_transitions(make_episodes([(length, False), (5, False)])))
    inside = rows.second_next_observation is not None and (rows.second_next_observation <= length).sum()
    assert inside == length - 2


@pytest.mark.parametrize("length", [2, 22, 1000])
def test_a_terminated_episode_ends_in_a_teleport(length: int) -> None:
    episodes = make_episodes([(length, True), (5, False)])
    rows = boundaries.released_triples(boundaries.released_transitions(episodes))
    states = walk(episodes)[0][0]
    own = [row for row in values(rows, episodes.observations, episodes.actions) if row.observation in states]
    assert len(own) == length - 1
    second_episode_start = walk(episodes)[1][0][0]
    assert own[-1].second == second_episode_start
    assert sum(row.second == second_episode_start for row in own) == 1


def test_a_thousand_steps_by_the_numbers() -> None:
    """Parity item 3: K = 200 and H = 1000 drift one row per trajectory."""
    expert = boundaries.released_transitions(make_episodes([(1000, False)] * 202, width=1))
    taken = boundaries.released_expert_prefix(expert, 200, 1000)
    assert len(taken) == 199_999
    assert len(boundaries.released_triples(taken)) == 199_798


@pytest.mark.parametrize(
    ("trajectories", "horizon", "rows", "triples"), [(30, 1000, 29_999, 29_968), (30, 200, 5_999, 5_968)]
)
def test_few_expert_by_the_numbers(trajectories: int, horizon: int, rows: int, triples: int) -> None:
    expert = boundaries.released_transitions(make_episodes([(horizon, False)] * (trajectories + 2), width=1))
    taken = boundaries.released_expert_prefix(expert, trajectories, horizon)
    assert (len(taken), len(boundaries.released_triples(taken))) == (rows, triples)


@pytest.mark.parametrize("trajectories", [200, 201, 10**6])
def test_a_count_that_is_not_reached_takes_every_row(trajectories: int) -> None:
    """SMODICE's rule: 200 timed-out episodes of 99 rows each never make 200 times 100."""
    expert = boundaries.released_transitions(make_episodes([(100, False)] * 200, width=1))
    assert len(boundaries.released_expert_prefix(expert, trajectories, 100)) == len(expert) == 200 * 99
    assert len(boundaries.released_expert_prefix(expert, 0, 100)) == 0


def test_terminated_trajectories_do_not_drift() -> None:
    expert = boundaries.released_transitions(make_episodes([(50, True)] * 32, width=1))
    assert len(boundaries.released_expert_prefix(expert, 30, 1000)) == 30 * 50 - 1


@given(endings())
def test_exact_transitions_keep_every_step(ends: Ends) -> None:
    episodes = make_episodes(ends)
    found = values(boundaries.exact_transitions(episodes), episodes.observations, episodes.actions)
    expected = [
        (states[t], moves[t], states[t + 1], terminated and t == len(moves) - 1)
        for states, moves, terminated in walk(episodes)
        for t in range(len(moves))
    ]
    assert [(row.observation, row.action, row.next_observation, row.terminal) for row in found] == expected


@given(endings())
def test_zero_mode_repairs_the_end(ends: Ends) -> None:
    episodes = make_episodes(ends)
    rows = boundaries.exact_triples(episodes, "zero", absorbing=-1)
    found = values(rows, episodes.observations, episodes.actions)
    assert sorted(map(repr, found)) == sorted(map(repr, exact_triples(episodes, "zero")))
    assert rows.sampled == len(rows)
