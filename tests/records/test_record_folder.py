"""Records on disk: whole, ours, unedited, or named in a warning."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers_engine import POLE_TASK, smoke_cell
from helpers_records import record_of

from lfobench.cells.cell import Run
from lfobench.errors import UserError
from lfobench.record import Warning
from lfobench.records.folder import RecordFolder, read_failures, read_record, select
from lfobench.records.sealed import SEAL
from lfobench.text import content_hash


def test_a_record_comes_back_as_it_was(folder: RecordFolder, run: Run) -> None:
    record = record_of(run)
    path = folder.write(run, record)
    assert read_record(path) == record
    assert folder.find(run) == record
    read = folder.read_all()
    assert read.records == [record]
    assert read.warnings == []


def test_the_file_is_plain_json_that_anyone_can_read(folder: RecordFolder, run: Run) -> None:
    content = json.loads(folder.write(run, record_of(run)).read_text(encoding="utf-8"))
    assert content["identity"]["seed"] == 3
    assert content["identity"]["task"] == POLE_TASK
    assert content["evaluations"][0]["returns"] == [0.1, 1 / 3]


def test_its_place_says_what_it_is(folder: RecordFolder, run: Run) -> None:
    path = folder.path(run)
    assert path.parent == folder.root / "records" / POLE_TASK
    assert path.name == f"bc-released-seed3-{run.identity_hash[:12]}.json"


def test_nothing_is_left_beside_it(folder: RecordFolder, run: Run) -> None:
    path = folder.write(run, record_of(run))
    assert list(path.parent.iterdir()) == [path]


def test_other_runs_are_not_found(folder: RecordFolder, run: Run) -> None:
    folder.write(run, record_of(run))
    assert folder.find(Run(run.cell, 4)) is None
    assert folder.find(Run(smoke_cell("bc", preset="paper"), 3)) is None


def edit(path: Path, *keys: str, value: Any) -> None:
    content = json.loads(path.read_text(encoding="utf-8"))
    place = content
    for key in keys[:-1]:
        place = place[int(key)] if isinstance(place, list) else place[key]
    place[keys[-1]] = value
    path.write_text(json.dumps(content), encoding="utf-8")


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("identity", "seed"), 0),
        (("identity", "config", "learning_rate"), 1.0),
        (("identity_hash",), "0" * 64),
    ],
)
def test_an_edited_identity_is_named_and_not_reused(
    folder: RecordFolder, run: Run, keys: tuple[str, ...], value: object
) -> None:
    path = folder.write(run, record_of(run))
    edit(path, *keys, value=value)
    assert folder.find(run) is None
    read = folder.read_all()
    assert read.records == []
    (warning,) = read.warnings
    assert str(path) in warning.what
    assert "edited" in warning.what
    assert warning.remedy


def test_edited_results_are_named_and_not_reused(folder: RecordFolder, run: Run) -> None:
    """Written once, never edited."""
    path = folder.write(run, record_of(run))
    edit(path, "evaluations", value=[{"step": 10, "returns": [9999.0, 9999.0], "lengths": [3, 4]}])
    assert folder.find(run) is None
    (warning,) = folder.read_all().warnings
    assert str(path) in warning.what


FOREIGN: dict[str, bytes] = {
    "other": b'{"name": "package", "version": 1}',
    "empty": b"",
    "list": b"[1, 2]",
    "not-json": b"{",
    "binary": bytes(range(256)),
    "nan": b"NaN",
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_foreign_files_are_named(folder: RecordFolder, run: Run, kind: str) -> None:
    record = record_of(run)
    folder.write(run, record)
    stranger = folder.root / "records" / f"{kind}.json"
    stranger.write_bytes(FOREIGN[kind])
    read = folder.read_all()
    assert read.records == [record]
    (warning,) = read.warnings
    assert str(stranger) in warning.what
    assert "\n" not in warning.what


@pytest.mark.parametrize("identity", [{}, {"seed": 3}, {"task": None, "method": 4, "seed": "x"}])
def test_a_record_with_half_an_identity_is_not_one_of_ours(
    folder: RecordFolder, run: Run, identity: dict[str, Any]
) -> None:
    stranger = folder.write(run, record_of(run))
    edit(stranger, "identity", value=identity)
    edit(stranger, "identity_hash", value=content_hash(identity))
    read = folder.read_all()
    assert read.records == []
    assert str(stranger) in read.warnings[0].what


def test_numbers_that_json_does_not_know_are_not_ours(folder: RecordFolder, run: Run) -> None:
    path = folder.write(run, record_of(run))
    edit(path, "identity", "config", "learning_rate", value=float("nan"))
    read = folder.read_all()
    assert read.records == []
    assert str(path) in read.warnings[0].what


def other_place(folder: RecordFolder) -> RecordFolder:
    return RecordFolder(folder.root / "merged")


def test_copies_of_one_record_count_once_and_are_named(folder: RecordFolder, run: Run) -> None:
    record = record_of(run)
    paths = [folder.write(run, record), other_place(folder).write(run, record_of(run, provenance={"elsewhere": True}))]
    read = folder.read_all()
    assert [found.measured() for found in read.records] == [record.measured()]
    (warning,) = read.warnings
    assert all(str(path) in warning.what for path in paths)


def test_records_of_one_run_that_contradict_each_other_do_not_count(folder: RecordFolder, run: Run) -> None:
    paths = [folder.write(run, record_of(run)), other_place(folder).write(run, record_of(run, metrics=[]))]
    read = folder.read_all()
    assert read.records == []
    assert read.contradicted == {run.identity_hash: sorted(paths)}
    (warning,) = read.warnings
    assert all(str(path) in warning.what for path in paths)


def test_copies_may_differ_in_what_only_describes_them(folder: RecordFolder, run: Run) -> None:
    folder.write(run, record_of(run))
    elsewhere = run.cell.labels.model_copy(update={"suite": "called otherwise"})
    other_place(folder).write(run, record_of(run, labels=elsewhere, warnings=[]))
    read = folder.read_all()
    assert len(read.records) == 1
    assert read.contradicted == {}


@pytest.mark.parametrize(
    ("leaf", "value"),
    [
        (("protocol",), "x"),
        (("protocol", "steps_assigned"), None),
        (("seed",), "abc"),
        (("environment",), {}),
        (("environment", "expert_return"), 5.0),
        (("config",), {}),
        (("simulator",), [1]),
    ],
    ids=lambda value: ".".join(value) if isinstance(value, tuple) else "",
)
def test_a_sealed_record_that_tables_cannot_read_is_not_ours(
    folder: RecordFolder, run: Run, leaf: tuple[str, ...], value: object
) -> None:
    """Whoever wrote it, no view may stumble over it later."""
    path = folder.write(run, record_of(run))
    content = json.loads(path.read_text(encoding="utf-8"))
    content["identity"]["environment"]["random_return"] = 5.0 if leaf[-1] == "expert_return" else 4.0
    place = content["identity"]
    for key in leaf[:-1]:
        place = place[key]
    place[leaf[-1]] = value
    content["identity_hash"] = content_hash(content["identity"])
    del content[SEAL]
    path.write_text(json.dumps({**content, SEAL: content_hash(content)}), encoding="utf-8")
    read = folder.read_all()
    assert read.records == []
    assert str(path) in read.warnings[0].what


def test_a_problem_is_named_with_its_place(folder: RecordFolder, run: Run) -> None:
    path = folder.write(run, record_of(run))
    edit(path, "labels", value={"suite": "s"})
    (warning,) = folder.read_all().warnings
    assert "labels.group" in warning.what


def test_records_of_another_schema_are_named(folder: RecordFolder, run: Run) -> None:
    path = folder.write(run, record_of(run))
    edit(path, "schema_version", value=99)
    edit(path, "evaluations", value="in another form")
    (warning,) = folder.read_all().warnings
    assert "99" in warning.what
    assert str(path) in warning.what


def test_a_truncated_record_runs_again(folder: RecordFolder, run: Run) -> None:
    path = folder.write(run, record_of(run))
    path.write_bytes(path.read_bytes()[:200])
    assert folder.find(run) is None
    assert len(folder.read_all().warnings) == 1


# --- what takes the place of a record and is none --------------------------------------------------------------------


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def two_gigabytes(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2 * 10**9)


def deep(path: Path) -> None:
    path.write_text("[" * 100_000 + "]" * 100_000, encoding="utf-8")


def long_number(path: Path) -> None:
    path.write_text('{"schema_version": 1, "status": ' + "9" * 100_000 + "}", encoding="utf-8")


def its_own_link(path: Path) -> None:
    path.symlink_to(path)


def is_a_folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize(
    ("make", "cause"),
    [
        (pipe, "not a regular file"),
        (endless, "not a regular file"),
        (two_gigabytes, "2,000,000,000 bytes"),
        (deep, "recursion"),
        (long_number, "digits"),
        (its_own_link, "symbolic links"),
        (is_a_folder, "directory"),
    ],
)
def test_what_is_no_file_of_ours_is_named_at_once(
    make: Callable[[Path], None], cause: str, folder: RecordFolder, run: Run
) -> None:
    """In place of a record, and of a report of a crash; the other records are read."""
    kept = folder.write(run, record_of(run))
    other = Run(run.cell, 4)
    for path in (folder.path(other), folder.failure(other)):
        path.parent.mkdir(parents=True, exist_ok=True)
        make(path)
    read = folder.read_all()
    assert read.records == [read_record(kept)]
    (warning,) = read.warnings
    assert str(folder.path(other)) in warning.what
    assert cause in warning.what.lower()
    assert folder.find(other) is None
    failures, skipped = read_failures(folder, read.records)
    assert failures == []
    assert [str(folder.failure(other)) in each.what for each in skipped] == [True]


def nested(levels: int) -> Any:
    value: Any = 1
    for _ in range(levels):
        value = {"deeper": [value]}
    return value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "value", "cause"),
    [
        (("evaluations", 0, "lengths"), [10**18, 1], "lengths.0"),
        (("evaluations", 0, "lengths"), [-1, 1], "lengths.0"),
        (("evaluations", 0, "step"), 10**18, "step"),
        (("diverged_at",), 10**18, "diverged_at"),
        (("evaluations", 0, "returns"), [1.0] * 100_001, "returns"),
        (("evaluations",), [{"step": 1, "returns": [1.0], "lengths": [1]}] * 1_000_000, "evaluations"),
        (("metrics",), [{"stage": "a", "step": 1, "values": {}}] * 100_001, "metrics"),
        (("identity", "protocol", "evaluation_episodes"), 10**18, "evaluation_episodes"),
        (("identity", "protocol", "steps"), 10**18, "steps"),
        (("identity", "recipe", "offline_transitions"), -1, "identity.recipe"),
        (("identity", "set"), nested(40), "identity"),
        (("provenance", "device"), nested(40), "provenance"),
    ],
    ids=lambda value: ".".join(map(str, value)) if isinstance(value, tuple) else "",
)
def test_counts_that_no_run_has_are_refused(
    place: tuple[str | int, ...], value: Any, cause: str, folder: RecordFolder, run: Run
) -> None:
    """Sealed like real ones."""
    path = folder.write(run, record_of(run))
    content = json.loads(path.read_text(encoding="utf-8"))
    del content[SEAL]
    inner = content
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    content["identity_hash"] = content_hash(content["identity"])
    path.write_text(json.dumps({**content, SEAL: content_hash(content)}), encoding="utf-8")
    outcome = read_record(path)
    assert isinstance(outcome, Warning)
    assert cause in outcome.what
    assert len(outcome.what) < 500


def test_no_folder_is_a_users_mistake(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"No folder .*nowhere.*lfobench run"):
        RecordFolder(tmp_path / "nowhere").read_all()


def test_a_file_is_not_a_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(UserError, match=r"file .*--out"):
        RecordFolder(tmp_path / "file").read_all()


def test_a_name_that_the_system_refuses(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="--out"):
        RecordFolder(tmp_path / ("x" * 300)).read_all()


def test_the_disk_refuses(tmp_path: Path, run: Run) -> None:
    """Below a regular file nothing can be written, not even by root."""
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(UserError, match="Cannot write"):
        RecordFolder(tmp_path / "file" / "out").write(run, record_of(run))


def test_a_full_disk_leaves_no_half_record(folder: RecordFolder, run: Run, full_disk: None) -> None:
    long = record_of(run, warnings=[Warning(what="w" * 500_000, remedy="")])
    with pytest.raises(UserError, match=r"Cannot write .*Free space"):
        folder.write(run, long)
    assert [path for path in folder.root.rglob("*") if path.is_file()] == []


def test_a_refused_rename_leaves_the_old_record(
    folder: RecordFolder, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = folder.write(run, record_of(run))
    before = path.read_bytes()

    def refuse(self: Path, target: Path) -> Path:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", refuse)
        with pytest.raises(UserError, match="Input/output error"):
            folder.write(run, record_of(run, status="diverged", diverged_at=1))
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_names_cannot_leave_the_folder(folder: RecordFolder, run: Run) -> None:
    wild = Run(replace(run.cell, task=replace(run.cell.task, name="../../etc/x y")), 0)
    assert folder.path(wild).resolve().is_relative_to(folder.root.resolve())


def test_selecting_records(run: Run) -> None:
    plain, paper = record_of(run), record_of(Run(smoke_cell("bc", preset="paper"), 3))
    records = [plain, paper]
    assert select(records, preset=None, protocol="smoke", source="generated", suite="tiny") == records
    assert select(records, preset="paper") == [paper]
    assert select(records, protocol="paper") == []
    assert select(records, steps=40) == records
    assert select(records, steps=41) == []
    assert select(records, source="d4rl") == []
    assert select(records, suite="locomotion") == []


def test_measured_is_everything_but_provenance(run: Run) -> None:
    one, two = record_of(run), record_of(run, provenance={})
    assert one.measured() == two.measured()
    assert "provenance" not in one.measured()
    assert one.measured() != record_of(run, warnings=[]).measured()
