"""Records as a frame, and the index that makes reading them again quick."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from helpers_folders import write_records
from helpers_records import make_record
from hypothesis import given, settings
from hypothesis import strategies as st

import lfobench
from lfobench.errors import UserError
from lfobench.record import Evaluation, Metrics, Record, Warning
from lfobench.records.folder import RecordFolder, read_record
from lfobench.records.frame import RUN_COLUMNS
from lfobench.records.index import index_path, read_index
from lfobench.records.sealed import SEAL
from lfobench.text import content_hash

HOUR = 3600 * 10**9


def write(path: Path, record: Record) -> Path:
    """A record of an hour ago: only a file that has settled is remembered."""
    return write_content(path, record.model_dump(mode="json"))


def write_content(path: Path, content: dict[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**content, SEAL: content_hash(content)}), encoding="utf-8")
    return aged(path)


def aged(path: Path) -> Path:
    before = time.time_ns() - HOUR
    os.utime(path, ns=(before, before))
    return path


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    root = tmp_path / "runs"
    for seed, score in enumerate([10.0, 30.0, 50.0]):
        write(root / "records" / "a" / f"dilo-{seed}.json", make_record(score, seed=seed))
    varied = make_record(20.0, "bc", evaluations=2)
    evaluations = [
        Evaluation(step=100, returns=[0.0, 100.0, 200.0], lengths=[1, 2, 3]),
        Evaluation(step=200, returns=[500.0], lengths=[7]),
    ]
    write(root / "records" / "b.json", varied.model_copy(update={"evaluations": evaluations}))
    return root


def by_hand(root: Path) -> list[tuple[Any, ...]]:
    return sorted(
        (
            record.method,
            record.seed,
            evaluation.step,
            score,
            float(np.mean(evaluation.returns)),
            len(evaluation.returns),
        )
        for record in RecordFolder(root).read_all().records
        for evaluation, (_, score) in zip(record.evaluations, record.curve(), strict=True)
    )


def test_one_row_per_run_and_evaluation(folder: Path) -> None:
    frame = lfobench.load(folder)
    assert list(frame.columns) == [*RUN_COLUMNS, "step", "score", "return", "length", "episodes", "identity"]
    rows = frame[["method", "seed", "step", "score", "return", "episodes"]]
    assert sorted(map(tuple, rows.to_numpy().tolist())) == by_hand(folder)
    assert frame.loc[frame["method"] == "bc", "length"].tolist() == [2.0, 7.0]


def test_one_row_per_episode(folder: Path) -> None:
    frame = lfobench.load(folder, episodes=True)
    bc = frame[frame["method"] == "bc"]
    assert bc["step"].tolist() == [100, 100, 100, 200]
    assert bc["episode"].tolist() == [0, 1, 2, 0]
    assert bc["score"].tolist() == [0.0, 10.0, 20.0, 50.0]
    assert bc["length"].tolist() == [1, 2, 3, 7]


def test_groups_as_anybody_would(folder: Path) -> None:
    finals = lfobench.load(folder).groupby(["task", "method"])["score"].mean()
    assert finals["hopper-random-expert", "dilo"] == pytest.approx(30.0)
    assert len(finals) == 2


def test_the_second_time_gives_the_same_and_opens_no_record(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, first_episodes = lfobench.load(folder), lfobench.load(folder, episodes=True)

    def forbidden(path: Path) -> Record:
        raise AssertionError(f"{path} was opened again")

    monkeypatch.setattr("lfobench.records.frame.read_record", forbidden)
    pd.testing.assert_frame_equal(lfobench.load(folder), first)
    pd.testing.assert_frame_equal(lfobench.load(folder, episodes=True), first_episodes)
    with pytest.raises(AssertionError, match="opened again"):
        lfobench.load(folder, fresh=True)


def test_new_and_removed_records_are_noticed(folder: Path) -> None:
    assert set(lfobench.load(folder)["seed"]) == {0, 1, 2}
    write(folder / "records" / "new.json", make_record(1.0, seed=9))
    (folder / "records" / "a" / "dilo-1.json").unlink()
    assert set(lfobench.load(folder)["seed"]) == {0, 2, 9}


def edited(path: Path) -> Path:
    """Another content of the same size, without a valid seal."""
    text = path.read_text(encoding="utf-8")
    assert "100.0" in text
    path.write_text(text.replace("100.0", "999.0"), encoding="utf-8")
    return path


def assert_seed_0_is_refused(folder: Path) -> None:
    with pytest.warns(UserWarning, match="edited"):
        frame = lfobench.load(folder)
    assert set(frame.loc[frame["method"] == "dilo", "seed"]) == {1, 2}


def test_an_edit_is_caught_by_the_seal(folder: Path) -> None:
    lfobench.load(folder)
    aged(edited(folder / "records" / "a" / "dilo-0.json"))
    assert_seed_0_is_refused(folder)
    assert_seed_0_is_refused(folder)


def test_an_edit_that_restores_the_time_of_modification_is_caught(folder: Path) -> None:
    """As unpacking an archive over a folder does."""
    lfobench.load(folder)
    path = folder / "records" / "a" / "dilo-0.json"
    before = path.stat().st_mtime_ns
    os.utime(edited(path), ns=(before, before))
    assert_seed_0_is_refused(folder)


def test_a_file_as_young_as_the_clock_is_coarse_is_not_remembered(folder: Path) -> None:
    path = folder / "records" / "a" / "dilo-0.json"
    path.touch()
    assert len(lfobench.load(folder)) == 17
    assert set(read_index(folder)) == {"records/a/dilo-1.json", "records/a/dilo-2.json", "records/b.json"}
    aged(path)
    lfobench.load(folder)
    assert len(read_index(folder)) == 4


def test_only_what_changed_is_opened_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lfobench.load(folder)
    opened = []

    def counted(path: Path) -> Record | Warning:
        opened.append(path)
        return read_record(path)

    monkeypatch.setattr("lfobench.records.frame.read_record", counted)
    again = write(folder / "records" / "a" / "dilo-1.json", make_record(31.0, seed=1))
    new = write(folder / "records" / "new.json", make_record(1.0, seed=9))
    frame = lfobench.load(folder)
    assert opened == [again, new]
    assert frame.loc[frame["seed"] == 1, "score"].tolist() == [31.0] * 5


def remove(path: Path) -> None:
    path.unlink()


def damage_bytes(path: Path) -> None:
    path.write_bytes(b"PK\x03\x04 not an archive")


def damage_tail(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


def damage_middle(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[content.index(b"returns.npy") + 200] ^= 1
    path.write_bytes(content)


def another_format(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def pickled(path: Path) -> None:
    with_arrays(path, header=np.array([{"version": 1}], dtype=object))


def with_arrays(path: Path, **changed: Any) -> None:
    with np.load(path) as arrays:
        found = dict(arrays)
    np.savez(path, **{**found, **changed})


def with_header(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    with np.load(path) as arrays:
        header = json.loads(arrays["header"].tobytes())
    change(header)
    with_arrays(path, header=np.frombuffer(json.dumps(header).encode(), np.uint8))


def other_version(path: Path) -> None:
    with_header(path, lambda header: header.update(version=0))


def no_fields(path: Path) -> None:
    with_header(path, lambda header: header["records"][0].update(fields={}))


def other_fields(path: Path) -> None:
    with_header(path, lambda header: header["records"][0]["fields"].update(seed="zero"))


def negative_count(path: Path) -> None:
    with_header(path, lambda header: header["records"][0].update(episodes=-1))


def shifted_counts(path: Path) -> None:
    def shift(header: dict[str, Any]) -> None:
        header["records"][0]["episodes"] += 1
        header["records"][1]["episodes"] -= 1

    with_header(path, shift)


def fewer_paths(path: Path) -> None:
    with_arrays(path, paths=np.frombuffer(b"records/b.json", np.uint8))


def fewer_returns(path: Path) -> None:
    with np.load(path) as arrays:
        returns = arrays["returns"]
    with_arrays(path, returns=returns[:-1])


def other_kind(path: Path) -> None:
    with np.load(path) as arrays:
        steps = arrays["steps"]
    with_arrays(path, steps=steps.astype(np.float32))


def other_shape(path: Path) -> None:
    with np.load(path) as arrays:
        steps = arrays["steps"]
    with_arrays(path, steps=steps[:, None])


@pytest.mark.parametrize(
    "damage",
    [
        remove,
        damage_bytes,
        damage_tail,
        damage_middle,
        another_format,
        pickled,
        other_version,
        no_fields,
        other_fields,
        negative_count,
        shifted_counts,
        fewer_paths,
        fewer_returns,
        other_kind,
        other_shape,
    ],
    ids=lambda one: one.__name__,
)
def test_a_useless_index_is_rebuilt(folder: Path, damage: Callable[[Path], None]) -> None:
    expected = lfobench.load(folder)
    damage(index_path(folder))
    assert read_index(folder) == {}
    pd.testing.assert_frame_equal(lfobench.load(folder), expected)
    assert len(read_index(folder)) == 4


@pytest.mark.slow
@settings(max_examples=100)
@given(st.data())
def test_no_damage_to_an_index_changes_a_frame(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        patch.setenv("LFOBENCH_CACHE", f"{name}/cache")
        root = Path(name, "runs")
        write(root / "a.json", make_record(10.0, evaluations=2))
        write(root / "b.json", make_record(20.0, seed=1, evaluations=1))
        expected = lfobench.load(root, episodes=True)
        content = bytearray(index_path(root).read_bytes())
        for _ in range(data.draw(st.integers(1, 3))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        index_path(root).write_bytes(
            content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
        )
        pd.testing.assert_frame_equal(lfobench.load(root, episodes=True), expected)


def test_an_index_that_cannot_be_written_is_done_without(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "file"))
    assert len(lfobench.load(folder)) == len(lfobench.load(folder)) > 0


def test_the_index_never_lies_next_to_the_records(folder: Path, cache: Path) -> None:
    before = sorted(folder.rglob("*"))
    lfobench.load(folder)
    assert sorted(folder.rglob("*")) == before
    assert index_path(folder).is_relative_to(cache)


def test_copies_count_once_and_contradictions_not_at_all(folder: Path) -> None:
    shutil.copy(folder / "records" / "a" / "dilo-0.json", folder / "copy.json")
    write(folder / "other.json", make_record(77.0, seed=1))
    for _ in range(2):
        with pytest.warns(UserWarning) as caught:
            frame = lfobench.load(folder)
        assert sorted("none of them counts" in str(one.message) for one in caught) == [False, True]
        assert all("copy.json" in str(one.message) or "other.json" in str(one.message) for one in caught)
        assert set(frame.loc[frame["method"] == "dilo", "seed"]) == {0, 2}
        assert len(frame[frame["seed"] == 2]) == 5


def test_a_run_that_diverged_at_once_has_a_row(folder: Path) -> None:
    write(folder / "sick.json", make_record(0.0, "oril", diverged_at=3, evaluations=0))
    kinds = {}
    for episodes in (False, True):
        frame = lfobench.load(folder, episodes=episodes)
        pd.testing.assert_frame_equal(lfobench.load(folder, episodes=episodes), frame)
        (row,) = frame[frame["method"] == "oril"].to_dict("records")
        assert (row["status"], row["step"]) == ("diverged", 3)
        assert np.isnan(row["score"])
        assert frame.loc[frame["method"] != "oril", ["score", "length"]].notna().all(axis=None)
        kinds[episodes] = frame.dtypes
    assert lfobench.load(folder).loc[lambda frame: frame["method"] == "oril", "episodes"].tolist() == [0]
    assert kinds[False]["step"] == kinds[False]["episodes"] == np.int64


def change_of(*place: str | int, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(content: dict[str, Any]) -> None:
        inner: Any = content
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (change_of("evaluations", 0, "lengths", value=[1, 2, 3]), "3 lengths"),
        (change_of("evaluations", 0, "lengths", value=[1]), "1 lengths"),
        (change_of("evaluations", 0, "lengths", value=[10**18, 1]), "lengths.0"),
        (change_of("evaluations", 0, "step", value=2**70), "step"),
        (change_of("identity", "seed", value=2**70), "seed"),
        (change_of("identity", "precision", value=[1]), "precision"),
    ],
    ids=["long", "short", "length", "step", "seed", "precision"],
)
def test_what_no_run_leaves_is_named_and_moves_nothing_else(
    folder: Path, change: Callable[[dict[str, Any]], None], cause: str
) -> None:
    """Sealed by whoever made it; first in order, so that all other rows come after it."""
    expected = {episodes: lfobench.load(folder, episodes=episodes) for episodes in (False, True)}
    content = make_record(1.0, "oril").model_dump(mode="json")
    change(content)
    content["identity_hash"] = content_hash(content["identity"])
    write_content(folder / "a.json", content)
    for episodes in (False, True, True):
        with pytest.warns(UserWarning, match=cause):
            frame = lfobench.load(folder, episodes=episodes)
        pd.testing.assert_frame_equal(frame, expected[episodes])


RETURNS = st.floats(-1e6, 1e6)
EPISODES = st.lists(st.tuples(RETURNS, st.integers(0, 1000)), min_size=1, max_size=4)


@settings(max_examples=25)
@given(st.lists(st.lists(EPISODES, max_size=3), max_size=4))
def test_any_records_give_the_numbers_that_records_give(runs: list[list[list[tuple[float, int]]]]) -> None:
    with tempfile.TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        patch.setenv("LFOBENCH_CACHE", f"{name}/cache")
        root = Path(name, "runs")
        root.mkdir()
        records = []
        for seed, run in enumerate(runs):
            evaluations = [
                Evaluation(step=step, returns=[each for each, _ in row], lengths=[length for _, length in row])
                for step, row in enumerate(run)
            ]
            made = make_record(0.0, seed=seed, diverged_at=None if run else 7)
            records.append(made.model_copy(update={"evaluations": evaluations}))
            write(root / f"{seed}.json", records[-1])
        for _ in range(2):
            frame = lfobench.load(root)
            scored = [(record.seed, *point) for record in records for point in record.curve()]
            found = frame.dropna(subset="score")[["seed", "step", "score"]].to_numpy(float)
            assert found == pytest.approx(np.array(scored, float).reshape(-1, 3))
            assert frame["seed"].unique().tolist() == [record.seed for record in records]
            single = lfobench.load(root, episodes=True).dropna(subset="score")
            assert list(zip(single["return"], single["length"], strict=True)) == [
                each for run in runs for row in run for each in row
            ]


def test_the_index_may_be_written_by_several_at_once(folder: Path) -> None:
    expected = lfobench.load(folder)
    program = (
        "import sys, lfobench\n"
        "for _ in range(20):\n"
        "    assert len(lfobench.load(sys.argv[1], fresh=True)) == len(lfobench.load(sys.argv[1])) == 17\n"
    )
    others = [subprocess.Popen([sys.executable, "-c", program, str(folder)]) for _ in range(2)]
    assert [other.wait() for other in others] == [0, 0]
    pd.testing.assert_frame_equal(lfobench.load(folder), expected)
    assert len(read_index(folder)) == 4
    assert list(index_path(folder).parent.iterdir()) == [index_path(folder)]


def test_reading_records_does_not_wait_for_what_trains() -> None:
    program = (
        "import sys, lfobench\n"
        "assert not {'pandas', 'numpy', 'torch'} & set(sys.modules)\n"
        "lfobench.load\n"
        "assert 'torch' not in sys.modules\n"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_an_empty_folder_is_an_empty_frame(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    frame = lfobench.load(tmp_path / "empty")
    assert frame.empty
    assert "score" in frame.columns
    with pytest.raises(UserError, match="No folder"):
        lfobench.load(tmp_path / "absent")


def trained(method: str, seed: int, *rows: Metrics) -> Record:
    return make_record(50.0, method, seed).model_copy(update={"metrics": list(rows)})


def test_training_metrics_are_columns(tmp_path: Path) -> None:
    records = [
        trained(
            "dilo",
            0,
            Metrics(stage="fit", step=10, values={"loss": 3.0}),
            Metrics(stage="train", step=100, values={"loss": 2.0, "seed": 5.0}),
            Metrics(stage="train", step=200, values={"loss": None, "seed": 6.0}),
        ),
        trained("bc", 1, Metrics(stage="train", step=100, values={"entropy": -1.5})),
        trained("oril", 2),
    ]
    frame = lfobench.load(write_records(tmp_path, records), metrics=True)
    assert list(frame.columns) == [*RUN_COLUMNS, "stage", "step", *sorted_metrics(frame), "identity"]
    dilo = frame[frame["method"] == "dilo"]
    assert list(zip(dilo["stage"], dilo["step"], strict=True)) == [("fit", 10), ("train", 100), ("train", 200)]
    assert list(dilo["loss"][:2]) == [3.0, 2.0] and dilo["loss"].isna().tolist() == [False, False, True]
    assert list(dilo["metric_seed"][1:]) == [5.0, 6.0] and set(dilo["seed"]) == {0}
    (cloned,) = frame[frame["method"] == "bc"].to_dict("records")
    assert cloned["entropy"] == -1.5 and np.isnan(cloned["loss"]) and cloned["identity"] == records[1].identity_hash
    assert "oril" not in set(frame["method"])
    assert frame["seed"].dtype == np.int64 and frame["step"].dtype == np.int64


def sorted_metrics(frame: pd.DataFrame) -> list[str]:
    """The columns of metrics, in the frame's order."""
    found = [name for name in frame.columns if name in ("loss", "entropy", "metric_seed")]
    assert sorted(found) == ["entropy", "loss", "metric_seed"]
    return found


def test_metrics_and_episodes_are_different_rows(folder: Path) -> None:
    with pytest.raises(UserError, match="Load two frames"):
        lfobench.load(folder, metrics=True, episodes=True)
