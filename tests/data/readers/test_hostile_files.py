"""Files that are damaged, mistaken or hostile: each is refused for what is wrong with it, and no link is followed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers_files import make_episodes, write_d4rl, write_minari, write_robomimic
from refusals import check_refusals, problem_of

from lfobench.data.readers import robomimic
from lfobench.data.readers.formats import read
from lfobench.data.readers.hdf5 import FileProblem
from lfobench.data.readers.reading import check


def replace_field(path: Path, field: str, **dataset: object) -> None:
    with h5py.File(path, "a") as file:
        del file[field]
        file.create_dataset(field, **dataset)


def link(path: Path, field: str, target: object) -> None:
    with h5py.File(path, "a") as file:
        del file[field]
        file[field] = target


def external_storage(path: Path) -> None:
    outside = path.with_name("outside.bin")
    outside.write_bytes(bytes(4 * 20))
    replace_field(path, "rewards", shape=(20,), dtype="f4", external=[(str(outside), 0, 80)])


def virtual(path: Path) -> None:
    other = path.with_name("other.hdf5")
    with h5py.File(other, "w") as file:
        file["rewards"] = np.zeros(20, np.float32)
    layout = h5py.VirtualLayout((20,), "f4")
    layout[:] = h5py.VirtualSource(other, "rewards", (20,))
    with h5py.File(path, "a") as file:
        del file["rewards"]
        file.create_virtual_dataset("rewards", layout)


def foreign_filter(path: Path) -> None:
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((20,))
    plist.set_filter(32001, h5py.h5z.FLAG_OPTIONAL)
    with h5py.File(path, "a") as file:
        del file["rewards"]
        space = h5py.h5s.create_simple((20,))
        h5py.h5d.create(file.id, b"rewards", h5py.h5t.NATIVE_FLOAT, space, plist).write(
            h5py.h5s.ALL, h5py.h5s.ALL, np.zeros(20, np.float32)
        )


def partly_written(path: Path) -> None:
    replace_field(path, "actions", shape=(20, 2), dtype="f4", chunks=(10, 2))
    with h5py.File(path, "a") as file:
        file["actions"][:10] = 1.0


def not_finite(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file["observations"][12, 1] = np.nan


def an_odd_flag(path: Path) -> None:
    flags = np.zeros(20, np.int8)
    flags[3] = 7
    replace_field(path, "terminals", data=flags)


def _rename(path: Path, fields: Sequence[str] = ("actions", "observations")) -> None:
    with h5py.File(path, "a") as file:
        for field in fields:
            file.move(field, {"actions": "moves", "observations": "places"}[field])


def no_end(path: Path) -> None:
    for field in ("terminals", "timeouts"):
        replace_field(path, field, data=np.zeros(20, np.bool_))


Facts = tuple[str, ...]

D4RL_CASES: dict[str, tuple[Callable[[Path], object], Facts]] = {
    "cut short": (lambda path: path.write_bytes(path.read_bytes()[:3000]), ("cut short",)),
    "empty": (lambda path: path.write_bytes(b""), ("empty",)),
    "a web page": (lambda path: path.write_text("\n<!DOCTYPE html><title>Log in"), ("web page",)),
    "a web page that begins with a byte order mark": (
        lambda path: path.write_text("\ufeff<!DOCTYPE html><title>Log in", "utf-8"),
        ("web page",),
    ),
    "a web page that begins with a comment": (
        lambda path: path.write_text("<!-- portal --><html>"),
        ("web page",),
    ),
    "an answer of the host": (
        lambda path: path.write_text('{"error": "quota \x1b[2J"}'),
        ("JSON", r'{"error": "quota \x1b[2J"}'),
    ),
    "a pointer": (lambda path: path.write_text("version https://git-lfs.github.com/spec/v1\n"), ("Git LFS",)),
    "something else": (lambda path: path.write_bytes(b"GIF89a"), ("HDF5", "NPZ")),
    "no known layout": (_rename, ("D4RL", "Minari", "robomimic", "moves, next_observations, places")),
    "one field is missing": (
        lambda path: _rename(path, ["actions"]),
        ("D4RL", "'actions'"),
    ),
    "rows differ": (
        lambda path: replace_field(path, "rewards", data=np.zeros(19)),
        ("'rewards'", "19", "'observations'", "20"),
    ),
    "columns differ": (
        lambda path: replace_field(path, "next_observations", data=np.zeros((20, 3))),
        ("'next_observations'", "3", "'observations'", "4"),
    ),
    "dimensions": (
        lambda path: replace_field(path, "actions", data=np.zeros(20)),
        ("'actions'", "1 dimension", "2"),
    ),
    "a scalar": (lambda path: replace_field(path, "rewards", data=1.0), ("'rewards'", "0 dimensions")),
    "nothing": (
        lambda path: replace_field(path, "rewards", data=h5py.Empty("f4")),
        ("'rewards'", "1 dimension"),
    ),
    "strings": (
        lambda path: replace_field(path, "rewards", data=np.array([b"one"] * 20)),
        ("'rewards'", "text"),
    ),
    "objects": (
        lambda path: replace_field(path, "rewards", shape=(20,), dtype=h5py.string_dtype()),
        ("'rewards'", "text"),
    ),
    "records": (
        lambda path: replace_field(path, "rewards", data=np.zeros(20, [("value", "f4")])),
        ("'rewards'", "type"),
    ),
    "complex numbers": (
        lambda path: replace_field(path, "rewards", data=np.zeros(20, np.complex64)),
        ("'rewards'", "complex"),
    ),
    "a group": (lambda path: link_group(path, "rewards"), ("'rewards'", "array")),
    "an external link": (
        lambda path: link(path, "rewards", h5py.ExternalLink("/etc/passwd", "/")),
        ("'rewards'", "link"),
    ),
    "a soft link": (lambda path: link(path, "rewards", h5py.SoftLink("/actions")), ("'rewards'", "link")),
    "external storage": (external_storage, ("'rewards'", "other files")),
    "virtual": (virtual, ("'rewards'", "other files")),
    "a foreign filter": (foreign_filter, ("'rewards'", "32001")),
    "declared and not there": (
        lambda path: replace_field(path, "observations", shape=(2**40, 4), dtype="f4", chunks=(1000, 4)),
        ("'observations'", "17,592,186,044,416"),
    ),
    "no column": (
        lambda path: replace_field(path, "actions", data=np.zeros((20, 0))),
        ("'actions'", "column"),
    ),
    "never written to its end": (
        partly_written,
        ("'actions'", "1 of 2 chunks"),
    ),
    "not finite": (not_finite, ("'observations'", "finite", "row 12")),
    "an odd flag": (an_odd_flag, ("'terminals'", "7", "row 3")),
    "no end": (no_end, ("'terminals'", "'timeouts'")),
    "no rows": (lambda path: write_d4rl(path, make_episodes([], [])), ("'observations'", "no row")),
}


def link_group(path: Path, field: str) -> None:
    with h5py.File(path, "a") as file:
        del file[field]
        file.create_group(field)


def test_d4rl_files_are_refused(tmp_path: Path) -> None:
    problems = {}
    for case, (spoil, facts) in D4RL_CASES.items():
        path = write_d4rl(tmp_path / f"{case}.hdf5", make_episodes())
        spoil(path)
        problems[case] = problem_of(path, *facts)
    check_refusals(problems, "d4rl")


def test_a_remedy_fits_a_file_of_ones_own(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(FileProblem) as caught:
        read(path)
    assert "download" in caught.value.remedy


def test_names_in_a_file_are_escaped_and_short(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "file.hdf5", "w") as file:
        for name in ("\x1b[2J\u202e", "n" * 3_000, *(f"o{index}" for index in range(20))):
            file[name] = 0
    with pytest.raises(FileProblem) as caught:
        read(tmp_path / "file.hdf5")
    listed = caught.value.cause.partition("(there: ")[2]
    assert listed.startswith(rf"\x1b[2J\u202e, {'n' * 39}…, o0, ")
    assert listed.endswith(", …)")
    assert caught.value.cause.isprintable()


def test_next_observations_that_are_not_kept_are_finite_too(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        file["next_observations"][3, 1] = np.nan
    with pytest.raises(FileProblem, match=r"'next_observations'.*row 3"):
        check(read(path))


def test_a_file_that_is_too_short_to_have_an_end(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes([20], [False]), ["timeouts"])
    with pytest.raises(FileProblem, match=r"'terminals'.*'timeouts'.*1,000 steps"):
        read(path, 1_000)


def test_without_timeouts_the_horizon_must_be_known(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes(), ["timeouts"])
    with pytest.raises(FileProblem, match="'timeouts'") as caught:
        read(path)
    assert "--horizon" in caught.value.remedy
    assert read(path, 9).episodes.lengths.tolist() == [7, 4, 9]


@pytest.mark.parametrize(
    ("field", "data", "facts"),
    [
        ("episode_1/observations", np.zeros((4, 4)), "'episode_1/observations' has 4 .*'episode_1/actions'"),
        ("episode_1/observations", np.zeros((5, 3)), "'episode_1/observations' has 3"),
        ("episode_1/rewards", np.zeros(3), "'episode_1/rewards' has 3"),
        ("episode_1/actions", np.zeros((0, 2)), "'episode_1'.*no step"),
        ("episode_1/terminations", np.ones(4, np.bool_), "'episode_1'.*last step"),
        ("episode_1/actions", np.array([[b"left"] * 2] * 4), "'episode_1/actions'.*text"),
    ],
)
def test_a_minari_file_is_refused(tmp_path: Path, field: str, data: np.ndarray, facts: str) -> None:  # type: ignore[type-arg]
    path = write_minari(tmp_path / "file.hdf5", make_episodes())
    replace_field(path, field, data=data)
    with pytest.raises(FileProblem, match=facts):
        read(path)


@pytest.mark.parametrize(
    ("field", "data", "facts"),
    [
        ("data/demo_0/obs/object", np.zeros((6, 1)), "'data/demo_0/obs/object' has 6"),
        ("data/demo_1/next_obs/object", np.zeros((4, 2)), "'data/demo_1/next_obs/object' has 2"),
        ("data/demo_2/actions", np.zeros((0, 2)), "'data/demo_2'.*no step"),
    ],
)
def test_a_robomimic_file_is_refused(tmp_path: Path, field: str, data: np.ndarray, facts: str) -> None:  # type: ignore[type-arg]
    path = write_robomimic(tmp_path / "file.hdf5", make_episodes(), robomimic.LOW_DIMENSIONAL)
    replace_field(path, field, data=data)
    with pytest.raises(FileProblem, match=facts):
        read(path)


def test_one_episode_under_many_names_is_not_many_episodes(tmp_path: Path) -> None:
    path = tmp_path / "file.hdf5"
    with h5py.File(path, "w") as file:
        first = file.create_group("episode_0")
        for name, shape in {"observations": (5001, 40), "actions": (5000, 2), "rewards": (5000,)}.items():
            first.create_dataset(name, data=np.zeros(shape, np.float32), compression="gzip")
        for name in ("terminations", "truncations"):
            first.create_dataset(name, data=np.zeros(5000, np.bool_), compression="gzip")
        for index in range(1, 60):
            file[f"episode_{index}"] = first
    with pytest.raises(FileProblem, match=r"'episode_0/observations'.* bytes"):
        read(path)


def test_a_folder_without_a_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileProblem, match=r"Minari.*LeRobot.*npz"):
        read(tmp_path)
