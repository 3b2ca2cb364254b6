"""Where jobs run must not matter; what ends one job must not end the others."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from helpers_engine import (
    SMOKE,
    Drifting,
    Dying,
    Raising,
    cell_of,
    make_job,
    never,
    records_of,
    smoke_cell,
)

from lfobench.cli.progress import Terminal
from lfobench.engine.job import Job, Recorded, run_job
from lfobench.engine.training import Advance
from lfobench.records.folder import RecordFolder, read_failures, write_failure
from lfobench.schedule import executors as pool
from lfobench.schedule.executors import Ended, Event, RunJob, in_processes, in_sequence

pytestmark = pytest.mark.slow


def endings(events: Sequence[Event]) -> dict[int, Ended]:
    return {event.index: event.what for event in events if isinstance(event.what, Ended)}


def outcomes(events: Sequence[Event]) -> dict[int, str]:
    return {index: ended.outcome for index, ended in endings(events).items()}


@pytest.mark.slow
def test_pool_and_local_leave_the_same_records(tmp_path: Path, shared_cache: Path) -> None:
    def jobs(out: str) -> list[Job]:
        return [
            make_job(smoke_cell(name), [seed], tmp_path / out, shared_cache)
            for name in ("dilo", "smodice")
            for seed in (0, 1)
        ]

    one, two = jobs("local"), jobs("pool")
    assert outcomes(list(in_sequence(one, run_job, never))) == dict.fromkeys(range(4), "done")
    assert outcomes(list(in_processes(two, run_job, 2, never))) == dict.fromkeys(range(4), "done")
    for here, there in zip(one, two, strict=True):
        assert [record.measured() for record in records_of(here)] == [record.measured() for record in records_of(there)]


@pytest.mark.slow
def test_a_worker_that_dies_fails_its_own_job_only(tmp_path: Path, shared_cache: Path) -> None:
    """More jobs than workers: the dead worker is replaced."""
    marker = tmp_path / "die"
    marker.touch()
    cells = [cell_of(Drifting), cell_of(Dying, marker=str(marker)), cell_of(Drifting), cell_of(Raising)]
    jobs = [make_job(cell, [seed], tmp_path / "out", shared_cache) for seed, cell in enumerate(cells)]
    events = list(in_processes(jobs, run_job, 1, never))
    assert outcomes(events) == {0: "done", 1: "failed", 2: "done", 3: "failed"}
    died, raised = endings(events)[1], endings(events)[3]
    assert "worker process died" in died.message
    assert "7" in died.message, "the exit code is named"
    assert "a bug in somebody's method" in raised.message
    assert "Traceback" in raised.detail
    marker.unlink()
    again = list(in_sequence(jobs[1:2], run_job, never))
    assert outcomes(again) == {0: "done"}


def test_a_bug_in_one_method_leaves_the_others_alone(tmp_path: Path, shared_cache: Path) -> None:
    jobs = [make_job(cell_of(method), [0], tmp_path, shared_cache) for method in (Raising, Drifting)]
    events = list(in_sequence(jobs, run_job, never))
    assert outcomes(events) == {0: "failed", 1: "done"}
    (line,) = endings(events)[0].place
    assert "helpers_engine.py:" in line
    assert line.endswith('in update: raise RuntimeError("a bug in somebody\'s method")')


def test_a_failure_shows_the_users_own_lines_and_keeps_them(
    tmp_path: Path, shared_cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = make_job(cell_of(Raising), [0], tmp_path, shared_cache)
    (ended,) = endings(list(in_sequence([job], run_job, never))).values()
    folder = RecordFolder(tmp_path)
    path = write_failure(folder, job.runs[0], f"{ended.message}\x1b[2J", ended.detail, ended.place)
    Terminal(quiet=True).failed(job, ended, [path])
    shown = capsys.readouterr().err.splitlines()
    assert "a bug in somebody's method" in shown[0] and "raise RuntimeError" in shown[1] and str(path) in shown[2]
    (failure,), warnings = read_failures(folder, [])
    assert not warnings and tuple(failure.place) == ended.place


def test_missing_data_is_reported_without_a_traceback(tmp_path: Path) -> None:
    job = Job(cell_of(Drifting), (0,), tmp_path / "out", tmp_path / "cache", "cpu")
    (ended,) = endings(list(in_sequence([job], run_job, never))).values()
    assert ended.outcome == "failed"
    assert "missing" in ended.message
    assert ended.detail == ""


def test_a_job_held_elsewhere_is_busy(tmp_path: Path, shared_cache: Path) -> None:
    jobs = [make_job(cell_of(Drifting), [seed], tmp_path, shared_cache) for seed in (0, 1)]
    holder = run_job(jobs[0], never)
    next(holder)
    assert outcomes(list(in_sequence(jobs, run_job, never))) == {0: "busy", 1: "done"}
    list(holder)


def test_a_stop_leaves_the_rest_for_the_next_command(tmp_path: Path, shared_cache: Path) -> None:
    jobs = [make_job(cell_of(Drifting), [seed], tmp_path, shared_cache) for seed in (0, 1, 2)]
    events: list[Event] = []
    for event in in_sequence(jobs, run_job, lambda: any(isinstance(event.what, Advance) for event in events)):
        events.append(event)
    assert outcomes(events) == {0: "stopped"}
    assert outcomes(list(in_sequence(jobs, run_job, never))) == dict.fromkeys(range(3), "done")


def crawl(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
    """Works until it is stopped; says who it is."""
    (job.out / f"{os.getpid()}.worker").touch()
    while not stop():
        time.sleep(0.05)
        yield Advance("crawling", 0, 1, None)


@pytest.mark.slow
def test_a_stop_reaches_every_worker_and_nothing_stays_behind(tmp_path: Path, shared_cache: Path) -> None:
    jobs = [make_job(cell_of(Drifting, SMOKE), [seed], tmp_path, shared_cache) for seed in (0, 1, 2)]
    seen: set[int] = set()
    events = []
    for event in in_processes(jobs, crawl, 2, lambda: len(seen) == 2):
        seen.add(event.index)
        events.append(event)
    assert outcomes(events) == {0: "stopped", 1: "stopped"}, "the third was not begun"
    assert_gone(tmp_path)


def assert_gone(folder: Path) -> None:
    """Not even a zombie is left of the workers that said who they are."""
    workers = list(folder.glob("*.worker"))
    assert workers
    for worker in workers:
        with pytest.raises(ProcessLookupError):
            os.kill(int(worker.stem), 0)


def dawdle(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
    """Does not care for a stop."""
    (job.out / f"{os.getpid()}.worker").touch()
    while True:
        time.sleep(0.05)
        yield Advance("dawdling", 0, 1, None)


@pytest.mark.slow
@pytest.mark.parametrize("work", [crawl, dawdle])
def test_whoever_stops_listening_leaves_no_process(
    work: RunJob, tmp_path: Path, shared_cache: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A second Ctrl-C; also with a worker that will not leave, or is too slow for it on a busy machine."""
    jobs = [make_job(cell_of(Drifting, SMOKE), [seed], tmp_path, shared_cache) for seed in (0, 1)]
    events = in_processes(jobs, work, 2, never)
    seen: set[int] = set()
    while len(seen) < 2:
        seen.add(next(events).index)
    with pytest.raises(KeyboardInterrupt):
        events.throw(KeyboardInterrupt())  # type: ignore[attr-defined]
    assert_gone(tmp_path)
    assert "Traceback" not in capfd.readouterr().err


def leave(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
    """What a method that calls ``sys.exit`` does to its job."""
    if job.seeds == (0,):
        raise SystemExit("enough")
    yield Advance("staying", 1, 1, None)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [None, 2])
def test_a_method_that_exits_ends_its_own_job_only(workers: int | None, tmp_path: Path, shared_cache: Path) -> None:
    jobs = [make_job(cell_of(Drifting, SMOKE), [seed], tmp_path, shared_cache) for seed in (0, 1)]
    events = list(in_sequence(jobs, leave, never) if workers is None else in_processes(jobs, leave, workers, never))
    assert outcomes(events) == {0: "failed", 1: "done"}
    assert "enough" in endings(events)[0].message


def report(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
    yield Advance("reporting", 1, 1, None)


@pytest.mark.slow
@pytest.mark.parametrize(("dead", "outcome"), [({1}, "done"), ({1, 2}, "failed")])
def test_a_worker_that_dies_between_two_jobs_is_replaced_once(
    dead: set[int], outcome: str, tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It seems alive when it is looked at, and its pipe is broken when it is given a job."""
    made: list[pool._Worker] = []

    class Worker(pool._Worker):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            made.append(self)
            if len(made) in dead:
                self.process.kill()
                self.process.join()
                monkeypatch.setattr(self.process, "is_alive", lambda: True)

    monkeypatch.setattr(pool, "_Worker", Worker)
    jobs = [make_job(cell_of(Drifting, SMOKE), [seed], tmp_path, shared_cache) for seed in (0, 1)]
    events = list(in_processes(jobs, report, 1, never))
    assert outcomes(events) == {0: outcome, 1: "done"}
    assert len(made) == len(dead) + 1
    if outcome == "failed":
        assert "worker process died" in endings(events)[0].message
