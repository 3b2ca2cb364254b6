from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from raw_rows import endings, make_episodes, walk

from lfobench.contract.episodes import Episodes, concatenate


@given(endings())
def test_every_transition_lies_between_its_two_observations(ends: list[tuple[int, bool]]) -> None:
    episodes = make_episodes(ends)
    index = episodes.observation_of_transition
    pairs = [(states[t], states[t + 1]) for states, moves, _ in walk(episodes) for t in range(len(moves))]
    for transition, (before, after) in enumerate(pairs):
        assert tuple(episodes.observations[index[transition]]) == before
        assert tuple(episodes.observations[index[transition] + 1]) == after


@given(endings())
def test_ends_are_marked_once_per_episode(ends: list[tuple[int, bool]]) -> None:
    episodes = make_episodes(ends)
    assert episodes.last_transition.sum() == len(ends)
    assert episodes.terminal_transition.sum() == sum(terminated for _, terminated in ends)
    assert not (episodes.terminal_transition & ~episodes.last_transition).any()
    firsts = [states[0] for states, _, _ in walk(episodes)]
    assert [tuple(row) for row in episodes.observations[episodes.first_observation]] == firsts


@given(endings())
def test_returns_are_sums_of_an_episodes_rewards(ends: list[tuple[int, bool]]) -> None:
    episodes = make_episodes(ends)
    start = 0
    for found, (length, _) in zip(episodes.returns(), ends, strict=True):
        assert found == pytest.approx(float(episodes.rewards[start : start + length].astype(np.float64).sum()))
        start += length


@given(endings(), endings())
def test_concatenation_keeps_every_episode(one: list[tuple[int, bool]], two: list[tuple[int, bool]]) -> None:
    first, second = make_episodes(one), make_episodes(two, start=10_000)
    assert walk(concatenate([first, second])) == walk(first) + walk(second)


@given(endings(), st.integers(0, 10))
def test_first_episodes_are_whole(ends: list[tuple[int, bool]], count: int) -> None:
    episodes = make_episodes(ends)
    assert walk(episodes.first_episodes(count)) == walk(episodes)[:count]


@given(endings(), st.integers(0, 100))
def test_first_transitions_cut_the_last_episode_by_time(ends: list[tuple[int, bool]], count: int) -> None:
    episodes = make_episodes(ends)
    cut = episodes.first_transitions(count)
    assert cut.transitions == min(count, episodes.transitions)
    whole, shortened = walk(episodes), walk(cut)
    for states, moves, terminated in shortened[:-1]:
        assert (states, moves, terminated) == whole.pop(0)
    if shortened:
        states, moves, terminated = shortened[-1]
        all_states, all_moves, ended = whole[0]
        assert states == all_states[: len(states)]
        assert moves == all_moves[: len(moves)]
        assert terminated == (ended and len(moves) == len(all_moves))


@pytest.mark.parametrize("name", ["observations", "actions", "rewards", "terminated"])
def test_arrays_of_wrong_length_are_refused(name: str) -> None:
    episodes = make_episodes([(3, True), (2, False)])
    with pytest.raises(ValueError, match=name):
        dataclasses.replace(episodes, **{name: getattr(episodes, name)[1:]})


def test_an_episode_without_a_step_is_refused() -> None:
    with pytest.raises(ValueError, match="no step"):
        Episodes(
            np.zeros((3, 1), np.float32),
            np.zeros((1, 1), np.float32),
            np.zeros(1, np.float32),
            np.array([1, 0]),
            np.array([True, False]),
        )
