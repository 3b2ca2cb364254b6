"""Records as a frame, and the index that makes reading them again quick."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from helpers_records import make_record

import lfobench
from lfobench.contract.record import Evaluation, Record, content_hash
from lfobench.errors import UserError
from lfobench.store.folder import SEAL, RecordFolder
from lfobench.store.frame import RUN_COLUMNS
from lfobench.store.index import index_path, read_index


def write(path: Path, record: Record) -> Path:
    content = record.model_dump(mode="json")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**content, SEAL: content_hash(content)}), encoding="utf-8")
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

    monkeypatch.setattr("lfobench.store.frame.read_record", forbidden)
    pd.testing.assert_frame_equal(lfobench.load(folder), first)
    pd.testing.assert_frame_equal(lfobench.load(folder, episodes=True), first_episodes)
    with pytest.raises(AssertionError, match="opened again"):
        lfobench.load(folder, fresh=True)


def test_new_and_removed_records_are_noticed(folder: Path) -> None:
    assert set(lfobench.load(folder)["seed"]) == {0, 1, 2}
    write(folder / "records" / "new.json", make_record(1.0, seed=9))
    (folder / "records" / "a" / "dilo-1.json").unlink()
    assert set(lfobench.load(folder)["seed"]) == {0, 2, 9}


def test_an_edit_is_caught_by_the_seal(folder: Path) -> None:
    lfobench.load(folder)
    path = folder / "records" / "a" / "dilo-0.json"
    path.write_text(path.read_text(encoding="utf-8").replace("100.0", "999.0"), encoding="utf-8")
    os.utime(path, ns=(0, path.stat().st_mtime_ns + 1))
    with pytest.warns(UserWarning, match="does not match its seal"):
        frame = lfobench.load(folder)
    assert set(frame.loc[frame["method"] == "dilo", "seed"]) == {1, 2}


def remove(path: Path) -> None:
    path.unlink()


def damage_bytes(path: Path) -> None:
    path.write_bytes(b"PK\x03\x04 not an archive")


def damage_tail(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


def damage_version(path: Path) -> None:
    with np.load(path) as arrays:
        found = dict(arrays)
    header = json.loads(found["header"].tobytes())
    found["header"] = np.frombuffer(json.dumps({**header, "version": 0}).encode(), np.uint8)
    np.savez(path, **found)


def damage_sum(path: Path) -> None:
    with np.load(path) as arrays:
        found = dict(arrays)
    found["returns"] = found["returns"][:-1]
    np.savez(path, **found)


def damage_kind(path: Path) -> None:
    with np.load(path) as arrays:
        found = dict(arrays)
    found["steps"] = found["steps"].astype(np.float32)
    np.savez(path, **found)


@pytest.mark.parametrize(
    "damage",
    [remove, damage_bytes, damage_tail, damage_version, damage_sum, damage_kind],
    ids=lambda one: one.__name__,
)
def test_a_useless_index_is_rebuilt(folder: Path, damage: Callable[[Path], None]) -> None:
    expected = lfobench.load(folder)
    damage(index_path(folder))
    assert read_index(folder) == {}
    pd.testing.assert_frame_equal(lfobench.load(folder), expected)
    assert len(read_index(folder)) == 4


def test_an_index_that_cannot_be_written_is_done_without(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "file"))
    assert len(lfobench.load(folder)) == len(lfobench.load(folder)) > 0


def test_the_index_never_lies_beside_the_records(folder: Path, cache: Path) -> None:
    before = sorted(folder.rglob("*"))
    lfobench.load(folder)
    assert sorted(folder.rglob("*")) == before
    assert index_path(folder).is_relative_to(cache)


def test_copies_count_once_and_contradictions_not_at_all(folder: Path) -> None:
    shutil.copy(folder / "records" / "a" / "dilo-0.json", folder / "copy.json")
    write(folder / "other.json", make_record(77.0, seed=1))
    for _ in range(2):
        with pytest.warns(UserWarning) as said:
            frame = lfobench.load(folder)
        assert {"are copies of one record", "differ in what they measured"} == {
            text
            for text in ("are copies of one record", "differ in what they measured")
            for one in said
            if text in str(one.message)
        }
        assert set(frame.loc[frame["method"] == "dilo", "seed"]) == {0, 2}
        assert len(frame[frame["seed"] == 2]) == 5


def test_a_run_that_diverged_at_once_has_a_row(folder: Path) -> None:
    write(folder / "sick.json", make_record(0.0, "oril", diverged_at=3, evaluations=0))
    for episodes in (False, True):
        frame = lfobench.load(folder, episodes=episodes)
        (row,) = frame[frame["method"] == "oril"].to_dict("records")
        assert (row["status"], row["step"]) == ("diverged", 3)
        assert np.isnan(row["score"])


def test_an_empty_folder_is_an_empty_frame(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    frame = lfobench.load(tmp_path / "empty")
    assert frame.empty
    assert "score" in frame.columns
    with pytest.raises(UserError, match="No folder"):
        lfobench.load(tmp_path / "absent")
