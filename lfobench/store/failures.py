"""Crashed runs on disk: what a table shows in place of their scores."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lfobench.contract.failure import Failure
from lfobench.contract.record import MOST_BYTES, Record, Warning
from lfobench.files import read_within, write_text
from lfobench.plan.cells import Run
from lfobench.store.folder import FAILURE_SUFFIX, RecordFolder


def write_failure(folder: RecordFolder, run: Run, error: str, traceback: str, place: Sequence[str] = ()) -> Path:
    """Keep what is known of a crashed run; a later crash of the same run takes its place."""
    path = folder.failure(run)
    failure = Failure(
        identity_hash=run.identity_hash,
        identity=run.identity,
        labels=run.cell.labels,
        error=error,
        place=list(place),
        traceback=traceback.splitlines(),
    )
    write_text(path, failure.model_dump_json(indent=1) + "\n")
    return path


def read_failures(folder: RecordFolder, records: list[Record]) -> tuple[list[Failure], list[Warning]]:
    """Crashed runs that have left no record since, and a warning for every file that does not tell of one."""
    done = {record.identity_hash for record in records}
    failures, warnings = [], []
    for path in folder.found(f"*{FAILURE_SUFFIX}"):
        try:
            failure = Failure.model_validate_json(read_within(path, MOST_BYTES))
        except (OSError, ValueError):
            what = f"{path} does not tell of a failed run and was skipped."
            warnings.append(Warning(what=what, remedy="Delete it; the run is tried again anyway."))
            continue
        if failure.identity_hash not in done:
            failures.append(failure)
    return failures, warnings
