"""Every layout gives back the episodes that were written, and says what it could not know."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers_files import LENGTHS, make_episodes, write_d4rl, write_minari, write_robomimic
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lfobench.contract.episodes import Episodes
from lfobench.data import boundaries
from lfobench.data.readers import arrays, hdf5, robomimic
from lfobench.data.readers.formats import read


def assert_same(found: Episodes, expected: Episodes) -> None:
    for name in ("observations", "actions", "rewards", "lengths", "terminated"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


shapes = st.lists(st.tuples(st.integers(1, 6), st.booleans()), min_size=1, max_size=6)
in_one_folder = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)


@in_one_folder
@given(shape=shapes, block=st.sampled_from([1, 40, 10**9]), chunked=st.booleans())
def test_d4rl(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shape: list[tuple[int, bool]], block: int, chunked: bool
) -> None:
    monkeypatch.setattr(arrays, "BLOCK_BYTES", block)
    episodes = make_episodes(*zip(*shape, strict=True))
    storage = {"chunks": True, "compression": "gzip", "shuffle": True} if chunked else {}
    reading = read(write_d4rl(tmp_path / "file.hdf5", episodes, **storage))
    assert_same(reading.episodes, episodes)
    assert (reading.format, len(reading.endless), len(reading.gaps)) == ("d4rl", 0, 0)


@in_one_folder
@given(shape=shapes, in_dictionary=st.booleans())
def test_minari(tmp_path: Path, shape: list[tuple[int, bool]], in_dictionary: bool) -> None:
    episodes = make_episodes(*zip(*shape, strict=True))
    reading = read(write_minari(tmp_path / "main_data.hdf5", episodes, in_dictionary))
    assert_same(reading.episodes, episodes)
    assert reading.keys == ({"observation": 4} if in_dictionary else {})


def test_minari_episodes_are_in_order_of_their_numbers_and_none_may_lack(tmp_path: Path) -> None:
    episodes = make_episodes([1 + index % 3 for index in range(12)], [False] * 12)
    path = write_minari(tmp_path / "main_data.hdf5", episodes)
    assert_same(read(path).episodes, episodes)
    with h5py.File(path, "a") as file:
        del file["episode_3"]
    with pytest.raises(hdf5.FileProblem, match=r"episode 3 .*episode_11"):
        read(path)


def test_a_minari_dataset_is_its_folder(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    episodes = make_episodes()
    write_minari(tmp_path / "data" / "main_data.hdf5", episodes)
    assert_same(read(tmp_path).episodes, episodes)


def test_robomimic(tmp_path: Path) -> None:
    episodes = make_episodes(terminated=[False] * 3)
    reading = read(write_robomimic(tmp_path / "file.hdf5", episodes, robomimic.LOW_DIMENSIONAL))
    assert_same(reading.episodes, episodes)
    assert (reading.format, tuple(reading.keys)) == ("robomimic", robomimic.LOW_DIMENSIONAL)


def test_without_next_observations_the_ends_are_unknown_and_no_exact_row_reaches_them(tmp_path: Path) -> None:
    episodes = make_episodes()
    path = write_d4rl(tmp_path / "file.hdf5", episodes, ["next_observations", "rewards"])
    reading = read(path)
    found = reading.episodes
    assert (reading.rewards, reading.ends_known, found.unknown_ends.tolist()) == (False, False, [True] * 3)
    assert np.isnan(found.rewards).all()
    np.testing.assert_array_equal(found.observations[found.known], episodes.observations[episodes.known & found.known])
    pairs, triples = boundaries.exact_transitions(found), boundaries.exact_triples(found, "zero", 0)
    assert (len(pairs), len(triples)) == (sum(LENGTHS) - 3, sum(LENGTHS) - 6)
    assert not triples.terminated.any()
    for rows in (pairs, triples):
        reached = [rows.observation, rows.next_observation, rows.second_next_observation]
        assert all(found.known[index].all() for index in reached if index is not None)
    # The released rows never reach them anyway.
    assert len(boundaries.released_transitions(found)) == len(boundaries.released_transitions(episodes))


def authors_transitions(path: Path, horizon: int) -> list[tuple[bytes, bytes, bool]]:
    """D4RL's reader row by row."""
    with h5py.File(path) as file:
        data = {name: file[name][:] for name in file}
    rows, step = [], 0
    for row in range(len(data["actions"]) - 1):
        final = bool(data["timeouts"][row]) if "timeouts" in data else step == horizon - 1
        step += 1
        if final:
            step = 0
            continue
        terminal = bool(data["terminals"][row])
        rows.append((data["observations"][row].tobytes(), data["observations"][row + 1].tobytes(), terminal))
        if terminal:
            step = 0
    return rows


@in_one_folder
@given(
    shape=shapes,
    leave_out=st.sampled_from([(), ("next_observations",), ("timeouts",), ("timeouts", "next_observations")]),
)
def test_released_rows_are_those_of_the_authors_reader(
    tmp_path: Path, shape: list[tuple[int, bool]], leave_out: tuple[str, ...]
) -> None:
    """Where time-outs are missing, episodes that time ended are as long as the horizon."""
    horizon = 6
    if "timeouts" in leave_out:
        shape = [(length, terminated) if terminated else (horizon, False) for length, terminated in shape]
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes(*zip(*shape, strict=True)), leave_out)
    expected = authors_transitions(path, horizon)
    found = read(path, horizon).episodes
    rows = boundaries.released_transitions(found)
    assert [
        (found.observations[here].tobytes(), found.observations[after].tobytes(), bool(terminal))
        for here, after, terminal in zip(rows.observation, rows.next_observation, rows.terminated, strict=True)
    ] == expected


def test_a_gap_ends_an_episode_and_is_told(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        file["timeouts"][6] = False
    reading = read(path)
    assert reading.gaps.tolist() == [6]
    assert_same(reading.episodes, make_episodes())


@pytest.mark.parametrize("block", [1, 100, 10**9])
def test_a_gap_at_the_edge_of_a_block_is_found_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(arrays, "BLOCK_BYTES", block)
    episodes = make_episodes([1] * 20, [False] * 20)
    path = write_d4rl(tmp_path / "file.hdf5", episodes)
    with h5py.File(path, "a") as file:
        file["timeouts"][:-1] = False
    assert read(path).gaps.tolist() == list(range(19))


def test_an_episode_without_an_end_is_cut_by_time(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        file["timeouts"][-1] = False
    reading = read(path)
    assert reading.endless.tolist() == [2]
    assert_same(reading.episodes, make_episodes())


def test_what_is_both_terminated_and_timed_out_is_timed_out(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        file["terminals"][6] = True
    reading = read(path)
    assert reading.both_flags == 1
    assert_same(reading.episodes, make_episodes())


@pytest.mark.parametrize("place", [(8, 1), (slice(None), 1), slice(None)], ids=["value", "column", "all"])
def test_values_that_are_not_finite_end_no_episode(tmp_path: Path, place: object) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        for field in ("observations", "next_observations"):
            file[field][place] = np.nan
    reading = read(path)
    assert (reading.episodes.lengths.tolist(), len(reading.gaps)) == (list(LENGTHS), 0)


def test_time_outs_within_an_episode_are_told(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    assert read(path).misplaced.tolist() == []
    with h5py.File(path, "a") as file:
        file["timeouts"][[5, 6]] = True, False
        file["timeouts"][[18, 19]] = True, True
    assert read(path).misplaced.tolist() == [5, 18]
    with h5py.File(path, "a") as file:
        del file["next_observations"]
    assert read(path).misplaced.tolist() == []
