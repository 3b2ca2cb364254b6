"""NPZ archives: one of flat arrays, or a folder of episodes; nothing is unpickled or unpacked out of proportion."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_files import flat_arrays, make_episodes, write_d4rl, write_npz, write_npz_folder
from refusals import check_refusals, problem_of

from lfobench.contract.episodes import Episodes
from lfobench.data.readers.formats import read, sha256, stamp
from lfobench.data.readers.hdf5 import FileProblem

EPISODES = make_episodes()


def assert_same(found: Episodes, expected: Episodes) -> None:
    for name in ("observations", "actions", "rewards", "lengths", "terminated"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


@pytest.mark.parametrize("compressed", [False, True])
def test_flat_arrays_are_read_as_d4rl_s(tmp_path: Path, compressed: bool) -> None:
    found = read(write_npz(tmp_path / "file.npz", EPISODES, compressed=compressed))
    assert_same(found.episodes, EPISODES)
    assert (found.format, found.timeouts, found.ends_known) == ("npz", True, True)
    for leave_out in (("timeouts",), ("rewards", "next_observations"), ("timeouts", "next_observations")):
        archive = read(write_npz(tmp_path / "part.npz", EPISODES, leave_out), 7)
        table = read(write_d4rl(tmp_path / "part.hdf5", EPISODES, leave_out), 7)
        assert_same(archive.episodes, table.episodes)
        assert (archive.rewards, archive.timeouts, archive.ends_known) == (
            table.rewards,
            table.timeouts,
            table.ends_known,
        )


def test_other_names_orders_and_kinds_of_numbers(tmp_path: Path) -> None:
    arrays = flat_arrays(EPISODES)
    np.savez(
        tmp_path / "file.npz",
        obs=np.asfortranarray(arrays["observations"].astype(">f8")),
        acts=arrays["actions"],
        next_obs=arrays["next_observations"],
        reward=arrays["rewards"][:, None],
        terminated=arrays["terminals"][:, None],
        truncated=arrays["timeouts"].astype(np.float64),
        infos=np.zeros(20),
    )
    found = read(tmp_path / "file.npz")
    assert_same(found.episodes, EPISODES)
    assert found.not_read == ("infos",)
    assert found.kinds["observations"] == {"float64": 1, "float32": 1}


@pytest.mark.parametrize("flags", [True, False])
def test_a_folder_has_an_episode_in_every_archive(tmp_path: Path, flags: bool) -> None:
    many = make_episodes([1 + index % 3 for index in range(12)], [index % 2 == 0 for index in range(12)])
    found = read(write_npz_folder(tmp_path / "folder", many, flags))
    expected = many if flags else make_episodes(many.lengths.tolist(), [False] * 12)
    assert_same(found.episodes, expected)
    assert (found.timeouts, found.ends_known, len(found.gaps), len(found.endless)) == (flags, True, 0, 0)


def test_flat_archives_of_a_folder_end_at_their_last_rows(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    for name in ("part_10", "part_9"):
        write_npz(tmp_path / "folder" / f"{name}.npz", EPISODES, ["timeouts", "next_observations"])
    found = read(tmp_path / "folder", 5).episodes
    assert found.lengths.tolist() == [11, 9, 11, 9]  # only the second episode of three has a flag
    assert found.terminated.tolist() == [True, False, True, False]


def test_an_archive_of_one_episode(tmp_path: Path) -> None:
    one = EPISODES.first_episodes(1)
    write_npz_folder(tmp_path / "folder", one)
    found = read(tmp_path / "folder" / "trajectory_0.npz")
    assert_same(found.episodes, one)
    assert found.endless.tolist() == []


def test_a_folder_is_what_is_in_its_files(tmp_path: Path) -> None:
    first, second = (write_npz_folder(tmp_path / name, EPISODES) for name in ("first", "second"))
    assert sha256(first) == sha256(second)
    (first / "notes.txt").write_text("not of the data")
    assert sha256(first) == sha256(second)
    before = stamp(first)
    (first / "trajectory_0.npz").rename(first / "trajectory_7.npz")
    assert sha256(first) != sha256(second) and stamp(first) != before
    assert len({sha256(first / "trajectory_7.npz"), sha256(first)}) == 2
    # One archive in a folder is an episode, and by itself perhaps many.
    for name in ("trajectory_1.npz", "trajectory_7.npz"):
        (first / name).unlink()
    assert sha256(first) != sha256(first / "trajectory_2.npz")


def save(path: Path, **changes: Any) -> None:
    arrays = {**flat_arrays(EPISODES), **changes}
    np.savez(path, **{name: values for name, values in arrays.items() if values is not None})


def with_member(path: Path, name: str, content: bytes, method: int = zipfile.ZIP_STORED) -> None:
    save(path, **{name: None})
    with zipfile.ZipFile(path, "a", method) as archive:
        archive.writestr(f"{name}.npy", content)


def npy(header: str, content: bytes = b"") -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + content


SPOILT: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "actions are missing": (lambda path: save(path, actions=None), ("'actions'", "observations")),
    "terminals are missing": (lambda path: save(path, terminals=None), ("'terminals'", "there:")),
    "two names of one thing": (lambda path: save(path, obs=np.zeros(3)), ("'observations'", "'obs'")),
    "objects": (lambda path: save(path, rewards=np.array([{}] * 20)), ("'rewards'", "text")),
    "text": (lambda path: save(path, rewards=np.array(["one"] * 20)), ("'rewards'", "text")),
    "rows": (lambda path: save(path, rewards=np.zeros(19)), ("'rewards'", "19", "'actions'", "20")),
    "columns": (lambda path: save(path, next_observations=np.zeros((20, 3))), ("'next_observations'", "3")),
    "dimensions": (lambda path: save(path, actions=np.zeros((20, 2, 2))), ("'actions'", "3")),
    "an odd flag": (lambda path: save(path, terminals=np.full(20, 2)), ("'terminals'", "2", "row 0")),
    "not finite": (
        lambda path: save(path, actions=np.full((20, 2), np.nan)),
        ("'actions'", "finite"),
    ),
    "no rows": (lambda path: np.savez(path, **flat_arrays(make_episodes([], []))), ("'actions'", "no row")),
    "a bomb": (
        lambda path: save_compressed(path, np.zeros((2**20, 40))),
        ("bytes",),
    ),
    "a shape beyond its bytes": (
        lambda path: with_member(path, "rewards", npy("{'descr': '<f4', 'fortran_order': False, 'shape': (9999999,)}")),
        ("'rewards'", "39,999,996"),
    ),
    "a negative shape": (
        lambda path: with_member(path, "rewards", npy("{'descr': '<f4', 'fortran_order': False, 'shape': (-4,)}")),
        ("'rewards'", "(-4,)"),
    ),
    "bytes beyond its shape": (
        lambda path: with_member(
            path, "rewards", npy("{'descr': '<f4', 'fortran_order': False, 'shape': (20,)}", bytes(84))
        ),
        ("'rewards'", "bytes"),
    ),
    "a header that is a program": (
        lambda path: with_member(path, "rewards", npy("{'descr': __import__('os').getcwd(), 'shape': (20,)}")),
        ("damaged",),
    ),
    "an array that is none": (lambda path: with_member(path, "rewards", b"nothing"), ("damaged",)),
    "another compression": (
        lambda path: with_member(path, "rewards", b"nothing", zipfile.ZIP_LZMA),
        ("'rewards'", "compressed"),
    ),
    "cut short": (lambda path: (save(path), path.write_bytes(path.read_bytes()[:900])), ("damaged",)),
}


def save_compressed(path: Path, observations: np.ndarray) -> None:  # type: ignore[type-arg]
    np.savez_compressed(path, observations=observations, actions=observations[:, :1], terminals=observations[:, 0])
    content = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        declared = archive.getinfo("observations.npy").file_size
    assert declared < 1_100 * len(content)  # deflate alone stays in proportion; the directory may say anything
    path.write_bytes(content.replace(declared.to_bytes(4, "little"), (2**32 - 2).to_bytes(4, "little")))


def test_spoilt_archives_are_refused(tmp_path: Path) -> None:
    problems = {}
    for case, (spoil, facts) in SPOILT.items():
        spoil(tmp_path / f"{case}.npz")
        problems[case] = problem_of(tmp_path / f"{case}.npz", *facts)
    del problems["a bomb"]  # its size depends on the version of zlib
    check_refusals(problems, "npz")


def test_a_folder_names_the_archive(tmp_path: Path) -> None:
    folder = write_npz_folder(tmp_path / "folder", EPISODES)
    np.savez(folder / "trajectory_1.npz", obs=EPISODES.observations[8:13])
    with pytest.raises(FileProblem, match=r"'trajectory_1\.npz/actions'.*trajectory_1\.npz/obs"):
        read(folder)
    np.savez(folder / "trajectory_1.npz", obs=np.zeros((5, 3)), acts=np.zeros((4, 2)))
    with pytest.raises(FileProblem, match=r"'trajectory_1\.npz/obs' has 3 .*'trajectory_0\.npz/obs' has 4"):
        read(folder)
    np.savez(folder / "trajectory_1.npz", obs=np.zeros((4, 4)), acts=np.zeros((4, 2)))
    with pytest.raises(FileProblem, match=r"'trajectory_0\.npz/obs'.*next_observations.*'trajectory_1"):
        read(folder)


def test_rewards_of_one_archive_may_be_missing(tmp_path: Path) -> None:
    folder = write_npz_folder(tmp_path / "folder", EPISODES)
    np.savez(folder / "trajectory_1.npz", obs=EPISODES.observations[8:13], acts=EPISODES.actions[7:11])
    found = read(folder)
    assert (found.rewards, found.rewardless, found.endless.tolist()) == (False, 1, [1])
