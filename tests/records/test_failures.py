"""Crashed runs on disk: kept, replaced by a later crash, hidden by a later record."""

from __future__ import annotations

from helpers_engine import POLE_TASK
from helpers_records import record_of

from lfobench.cells.cell import Run
from lfobench.record import Failure
from lfobench.records.folder import RecordFolder, read_failures, write_failure


def test_a_failure_comes_back_as_it_was(folder: RecordFolder, run: Run) -> None:
    path = write_failure(folder, run, "ValueError: gone", "Traceback:\n  File x\nValueError: gone")
    (failure,), warnings = read_failures(folder, [])
    assert warnings == []
    assert failure == Failure(
        identity_hash=run.identity_hash,
        identity=run.identity,
        labels=run.cell.labels,
        error="ValueError: gone",
        traceback=["Traceback:", "  File x", "ValueError: gone"],
    )
    assert (failure.method, failure.task, failure.seed) == ("bc", POLE_TASK, 3)
    assert path.parent == folder.root / "failures" / POLE_TASK
    assert list(path.parent.iterdir()) == [path]


def test_a_failure_is_no_record_and_no_foreign_file(folder: RecordFolder, run: Run) -> None:
    write_failure(folder, run, "gone", "")
    read = folder.read_all()
    assert (read.records, read.warnings) == ([], [])


def test_a_later_crash_takes_the_place_of_an_earlier_one(folder: RecordFolder, run: Run) -> None:
    write_failure(folder, run, "first", "")
    write_failure(folder, run, "second", "")
    assert [failure.error for failure in read_failures(folder, [])[0]] == ["second"]


def test_a_record_since_hides_the_crash_of_its_own_run_alone(folder: RecordFolder, run: Run) -> None:
    other = Run(run.cell, 4)
    for each in (run, other):
        write_failure(folder, each, "gone", "")
    folder.write(run, record_of(run))
    failures, _ = read_failures(folder, folder.read_all().records)
    assert [failure.seed for failure in failures] == [4]


def test_files_that_are_no_reports_are_named_and_skipped(folder: RecordFolder, run: Run) -> None:
    whole = write_failure(folder, run, "gone", "")
    text = whole.read_text(encoding="utf-8")
    strangers = {
        "cut.failure": text[:40],
        "empty.failure": "",
        "binary.failure": "\x00\x01",
        "list.failure": "[1, 2]",
        "lacking.failure": text.replace('"seed"', '"sead"'),
        "more.failure": text.replace('"error"', '"unknown": 1, "error"'),
    }
    for name, content in strangers.items():
        (whole.parent / name).write_text(content, encoding="utf-8")
    failures, warnings = read_failures(folder, [])
    assert len(failures) == 1
    assert sorted(warning.what.split()[0] for warning in warnings) == sorted(
        str(whole.parent / name) for name in strangers
    )
    assert all("Delete it" in warning.remedy for warning in warnings)


def test_a_folder_without_crashes(folder: RecordFolder) -> None:
    assert read_failures(folder, []) == ([], [])
