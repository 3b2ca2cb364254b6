"""LeRobot's datasets of version 3: tables of frames, without their videos."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers_files import make_episodes, write_lerobot

from lfobench.contract.episodes import Episodes
from lfobench.data.readers.formats import read, sha256
from lfobench.data.readers.hdf5 import FileProblem

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

FIRST, SECOND = make_episodes((7, 4), (False, False)), make_episodes((9, 2, 1), (False, False, False))
BOTH = ("observation.state", "observation.environment_state")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_lerobot(tmp_path / "dataset", [FIRST, SECOND])


def table_of(folder: Path, number: int = 0) -> Path:
    return folder / "data" / "chunk-000" / f"file-{number:03d}.parquet"


def change(path: Path, name: str, values: object) -> None:
    """Another column in place of one; None takes it out."""
    found = parquet.read_table(path)
    place = found.schema.get_field_index(name)
    found = found.remove_column(place)
    if values is not None:
        found = found.add_column(place, name, pyarrow.array(values))
    parquet.write_table(found, path)


def seen(episodes: Episodes) -> np.ndarray:  # type: ignore[type-arg]
    return episodes.observations[episodes.observation_of_transition]


def test_episodes_of_all_tables(folder: Path) -> None:
    found = read(folder)
    episodes = found.episodes
    assert episodes.lengths.tolist() == [7, 4, 9, 2, 1]
    np.testing.assert_array_equal(seen(episodes), np.vstack([seen(FIRST), seen(SECOND)])[:, :-1])
    np.testing.assert_array_equal(episodes.actions, np.vstack([FIRST.actions, SECOND.actions]))
    np.testing.assert_array_equal(episodes.rewards, np.concatenate([FIRST.rewards, SECOND.rewards]))
    assert episodes.unknown_ends.all() and not episodes.terminated.any()
    assert (found.format, found.timeouts, found.ends_known) == ("lerobot", False, False)
    assert (found.keys, found.left_out) == (
        {"observation.state": 3},
        {"observation.environment_state": 1, "observation.image": 0},
    )
    assert found.not_read == ("timestamp", "index", "task_index")
    assert (found.declared_episodes, found.declared_steps) == (5, 23)
    assert (found.endless.size, found.ended_within.size) == (0, 0)


def test_keys_can_be_chosen(folder: Path) -> None:
    found = read(folder, keys=BOTH[::-1])
    whole = np.vstack([seen(FIRST), seen(SECOND)])
    np.testing.assert_array_equal(seen(found.episodes), whole[:, [3, 0, 1, 2]])
    with pytest.raises(FileProblem, match=r"file-000\.parquet/observation\.image'"):
        read(folder, keys=("observation.image",))


def test_a_dataset_is_the_content_of_its_files(folder: Path, tmp_path: Path) -> None:
    again = write_lerobot(tmp_path / "again", [FIRST, SECOND])
    assert sha256(folder) == sha256(again)
    (again / "videos").mkdir()
    (again / "videos" / "a.mp4").write_bytes(b"film")
    assert sha256(folder) == sha256(again)
    change(table_of(again, 1), "next.reward", [0.0] * 12)
    assert sha256(folder) != sha256(again)


@pytest.mark.parametrize("name", ["observation.state", "action", "episode_index", "frame_index"])
def test_what_is_missing_is_named_with_its_table(folder: Path, name: str) -> None:
    change(table_of(folder, 1), name, None)
    with pytest.raises(FileProblem) as caught:
        read(folder)
    assert f"'data/chunk-000/file-001.parquet/{name}'" in caught.value.cause and "there:" in caught.value.cause
    assert ("keys=" in caught.value.remedy) == (name == "observation.state")


def test_rewards_and_ends_may_be_missing(folder: Path) -> None:
    for name in ("next.reward", "next.done"):
        change(table_of(folder, 1), name, None)
    found = read(folder)
    assert (found.rewards, found.rewardless) == (False, 1)
    assert np.isnan(found.episodes.rewards).all()
    assert found.endless.size == 0


def test_ends_that_are_elsewhere(folder: Path) -> None:
    done = np.zeros(11, np.bool_)
    done[[2, 10]] = True
    change(table_of(folder), "next.done", done)
    found = read(folder)
    assert (found.endless.tolist(), found.ended_within.tolist()) == ([0], [2])


@pytest.mark.parametrize(
    ("name", "values", "named"),
    [
        ("action", [[0.0, 1.0]] * 10 + [[0.0]], "file-000.parquet/action'.*length"),
        ("action", [[0.0, 1.0]] * 10 + [None], "action'.*without a value"),
        ("action", [[0.0, 1.0]] * 10 + [[0.0, None]], "action'.*without a value"),
        ("action", ["left"] * 11, "action'.*string"),
        ("action", [[[0.0]]] * 11, "action'.*list"),
        ("action", [[0.0, 1.0, 2.0]] * 11, "2 numbers.*3"),
        ("frame_index", [0, 1, 2, 4, 5, 6, 7, 0, 1, 2, 3], "frame 3 of episode 0.*row 3.*frame_index 4"),
        ("episode_index", [0] * 3 + [1] * 4 + [0] * 4, "episode 0.*row 7"),
        ("episode_index", [5] * 7 + [6] * 4, "episode 2.*row 11"),
        ("episode_index", [0.5] * 11, "episode_index'.*whole numbers"),
        ("next.done", [2] * 11, "'next.done'.*2.*row 0"),
    ],
)
def test_a_spoilt_column_is_refused(folder: Path, name: str, values: object, named: str) -> None:
    change(table_of(folder), name, values)
    with pytest.raises(FileProblem, match=named):
        read(folder)


def test_numbers_of_several_types_are_counted(folder: Path) -> None:
    change(table_of(folder, 1), "action", SECOND.actions.astype(np.float64).tolist())
    assert read(folder).kinds == {"action": {"float32": 1, "float64": 1}}


@pytest.mark.parametrize(
    ("information", "named"),
    [
        ({"codebase_version": "v2.1"}, "v2.1.*3"),
        ({"codebase_version": None}, "version"),
    ],
)
def test_other_versions_are_refused(tmp_path: Path, information: dict[str, object], named: str) -> None:
    with pytest.raises(FileProblem, match=named):
        read(write_lerobot(tmp_path / "dataset", [FIRST], **information))


def test_a_damaged_dataset(folder: Path) -> None:
    table = table_of(folder, 1)
    table.write_bytes(table.read_bytes()[:-20])
    with pytest.raises(FileProblem, match=r"'data/chunk-000/file-001\.parquet'.*damaged"):
        read(folder)
    (folder / "meta" / "info.json").write_text("{")
    with pytest.raises(FileProblem, match=r"meta/info\.json.*JSON"):
        read(folder)
    (folder / "meta" / "info.json").write_text(json.dumps([]))
    with pytest.raises(FileProblem, match="version"):
        read(folder)
    for number in (0, 1):
        table_of(folder, number).unlink()
    with pytest.raises(FileProblem, match=r"data/\*/\*\.parquet"):
        read(folder)


def test_rows_out_of_proportion(folder: Path) -> None:
    rows = 20_000_000
    same = pyarrow.array(np.zeros(rows, np.int8))
    names = ("observation.state", "action", "episode_index", "frame_index")
    parquet.write_table(pyarrow.table(dict.fromkeys(names, same)), table_of(folder))
    with pytest.raises(FileProblem, match="20,000,000 rows"):
        read(folder)


@pytest.mark.parametrize("fixed", [True, False])
def test_lists_out_of_proportion(fixed: bool, folder: Path) -> None:
    """The width of rows counts: few of them, of very many zeros."""
    rows, width = 11, 1_000_000
    zeros = pyarrow.array(np.zeros(rows * width, np.float32))
    offsets = pyarrow.array(np.arange(rows + 1, dtype=np.int32) * width)
    wide = (
        pyarrow.FixedSizeListArray.from_arrays(zeros, width) if fixed else pyarrow.ListArray.from_arrays(offsets, zeros)
    )
    change(table_of(folder), "action", wide)
    with pytest.raises(FileProblem, match=r"11 rows .*11,000,0\d\d numbers"):
        read(folder)


def test_rows_of_a_fixed_width_are_read(folder: Path) -> None:
    actions = pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(FIRST.actions.ravel()), FIRST.actions.shape[1])
    change(table_of(folder), "action", actions)
    np.testing.assert_array_equal(read(folder).episodes.actions[:11], FIRST.actions)


def test_without_pyarrow_the_extra_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("pyarrow", "pyarrow.parquet"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(FileProblem) as caught:
        read(folder)
    assert "lfobench[lerobot]" in caught.value.remedy


def test_one_table_is_no_dataset(folder: Path) -> None:
    with pytest.raises(FileProblem, match="Parquet"):
        read(table_of(folder))
