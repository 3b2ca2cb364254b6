"""Stops, and commands that share a folder: who does what, who waits, and what ends the waiting."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers_engine import POLE_TASK, TINY, finish, make_job

from lfobench.cells.cell import Run
from lfobench.cells.plan import Request, make_plan
from lfobench.engine import job as engine_job
from lfobench.engine.job import Job
from lfobench.errors import UserError
from lfobench.files import locked
from lfobench.record import Warning
from lfobench.records.folder import RecordFolder, RecordsRead
from lfobench.schedule import execution
from lfobench.schedule.execution import StopRequest, Tally, Watcher, execute_schedule
from lfobench.schedule.executors import Ended, Event
from lfobench.schedule.jobs import Forecast, Schedule, make_schedule


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_asks_for_a_stop(number: signal.Signals) -> None:
    announced: list[bool] = []
    stop = StopRequest(lambda: announced.append(True))
    before = signal.getsignal(number)
    with stop.listening():
        os.kill(os.getpid(), number)
        assert stop()
    assert announced == [True]
    assert signal.getsignal(number) == before


def test_schedulers_repeat_themselves_and_a_user_who_does_means_at_once() -> None:
    stop, went_on = StopRequest(), False
    with stop.listening():
        for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGHUP, signal.SIGTERM):
            os.kill(os.getpid(), number)
        went_on = True
        os.kill(os.getpid(), signal.SIGINT)
        pytest.fail("the second Ctrl-C ends the block")
    assert went_on
    assert stop()


def test_nohup_is_obeyed() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        stop = StopRequest()
        with stop.listening():
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop()
    finally:
        signal.signal(signal.SIGHUP, before)


# --- commands that share a folder ------------------------------------------------------------------------------------


class Witness(Watcher):
    """Remembers how many runs were waited for, and does something when they are; counts the jobs that trained."""

    def __init__(self, then: Callable[[], None] = lambda: None) -> None:
        self.waited: list[int] = []
        self.trained: list[tuple[int, ...]] = []
        self._then = then

    def waiting(self, runs: int) -> None:
        self.waited.append(runs)
        self._then()

    def training(self, schedule: Schedule, expected: Forecast, events: Iterator[Event]) -> Iterator[Event]:
        assert len(expected.job_seconds) == len(schedule.jobs)
        self.trained += [job.seeds for job in schedule.jobs]
        return events


@pytest.fixture
def schedule(tmp_path: Path, shared_cache: Path) -> Schedule:
    """Three seeds of one cell; their data is there."""
    plan = make_plan(Request("bc", TINY, POLE_TASK, seeds="0-2", protocol="smoke", device="cpu"), lambda: False)
    make_job(plan.cells[0], [0], tmp_path, shared_cache)
    return make_schedule(plan, RecordsRead(), tmp_path / "out", shared_cache, 1)


@pytest.fixture
def other(schedule: Schedule) -> Iterator[ExitStack]:
    """Another process, which is training seed 1."""
    folder = RecordFolder(schedule.jobs[0].out)
    folder.checkpoints.mkdir(parents=True)
    with ExitStack() as held:
        held.enter_context(locked(folder.lock(schedule.jobs[1].runs[0]), "--out"))
        yield held


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(execution, "WAIT_SECONDS", 0.01)


def carry_out(schedule: Schedule, watcher: Watcher, stop: StopRequest | None = None, wait: bool = True) -> Tally:
    expected = Forecast([1.0] * len(schedule.jobs), 1.0, ())
    return execute_schedule(schedule, expected, schedule.jobs[0].out, stop or StopRequest(), watcher, wait)


def done(schedule: Schedule) -> list[int]:
    folder = RecordFolder(schedule.jobs[0].out)
    return [seed for seed in schedule.plan.seeds if folder.find(Run(schedule.plan.cells[0], seed))]


def test_what_another_process_trains_is_waited_for(schedule: Schedule, other: ExitStack) -> None:
    def finishes() -> None:
        other.close()
        finish(schedule.jobs[1])

    witness = Witness(finishes)
    assert carry_out(schedule, witness) == Tally()
    assert done(schedule) == [0, 1, 2]
    assert witness.waited == [1]
    assert witness.trained == [(0,), (1,), (2,)], "of which the second was left to the other"


def test_what_a_dead_process_leaves_is_taken_over(schedule: Schedule, other: ExitStack) -> None:
    """The system lets go of its lock; there is no record."""
    witness = Witness(other.close)
    assert carry_out(schedule, witness) == Tally()
    assert done(schedule) == [0, 1, 2]
    assert witness.trained[3:] == [(1,)]


def test_a_stop_ends_the_wait(schedule: Schedule, other: ExitStack) -> None:
    stop = StopRequest()

    def asked() -> None:
        stop.asked = True

    assert carry_out(schedule, Witness(asked), stop) == Tally(busy=1, stopped=True)
    assert done(schedule) == [0, 2]


def test_no_wait_leaves_them_and_says_so(schedule: Schedule, other: ExitStack) -> None:
    witness = Witness()
    assert carry_out(schedule, witness, wait=False) == Tally(busy=1)
    assert witness.waited == []
    assert done(schedule) == [0, 2]


def test_a_file_system_without_locks_is_named_before_anything_trains(
    schedule: Schedule, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    witness = Witness()
    with pytest.raises(UserError, match=r"has no file locks .*--out"):
        carry_out(schedule, witness)
    assert witness.trained == []


class Losses(Witness):
    """Remembers the crashes, and the warnings."""

    def __init__(self, then: Callable[[], None] = lambda: None) -> None:
        super().__init__(then)
        self.kept: list[Path] = []
        self.warned: list[Warning] = []

    def failed(self, job: Job, ended: Ended, kept: Sequence[Path]) -> None:
        self.kept += kept

    def warn(self, warnings: Iterable[Warning]) -> None:
        self.warned += warnings


def crash(*_: Any) -> Iterator[Any]:
    raise RuntimeError("a bug in somebody's method")
    yield


def test_a_crash_is_not_that_of_seeds_which_another_process_trains(
    schedule: Schedule, other: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All seeds in one job, as on a GPU: two crash, one is waited for."""
    job, folder = replace(schedule.jobs[0], seeds=(0, 1, 2)), RecordFolder(schedule.jobs[0].out)

    def finishes() -> None:
        monkeypatch.undo()
        other.close()
        finish(schedule.jobs[1])

    monkeypatch.setattr(engine_job, "_train", crash)
    losses = Losses(finishes)
    assert carry_out(replace(schedule, jobs=[job]), losses) == Tally(failed=1)
    assert losses.waited == [1]
    assert losses.kept == [folder.failure(job.runs[seed]) for seed in (0, 2)]
    assert done(schedule) == [1]
    assert not folder.failure(job.runs[1]).exists()


def test_a_crash_that_a_full_disk_does_not_keep_is_a_warning(
    schedule: Schedule, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> Path:
        raise UserError("Cannot write x.failure: No space left on device.", "Free space.")

    monkeypatch.setattr(engine_job, "_train", crash)
    monkeypatch.setattr(execution, "write_failure", full)
    losses = Losses()
    assert carry_out(schedule, losses) == Tally(failed=3)
    assert losses.kept == []
    assert [warning.remedy for warning in losses.warned if "No space left" in warning.what] == ["Free space."] * 3
