"""Execution of a schedule: data is built, files are looked at, runs train; a stop saves and leaves the rest.

Nothing is printed here: a `Watcher` sees all of it.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType

from lfobench.cells.cell import Cell
from lfobench.cells.parts import build_command
from lfobench.cells.sources import check_here, spelled
from lfobench.contract.method import Method, Shapes
from lfobench.data.build import ImportJob, ShardJob, build, check_present
from lfobench.data.cache import GENERATED
from lfobench.data.remarks import check_parts, remarks
from lfobench.data.source import load_task
from lfobench.engine.job import Job, Recorded, TrainedElsewhere, run_job
from lfobench.engine.method_check import require_sound
from lfobench.errors import UserError
from lfobench.files import Held, is_held, locked, remove_leftovers, writable_folder
from lfobench.record import Warning
from lfobench.records.folder import RecordFolder, write_failure
from lfobench.schedule.executors import Ended, Event, in_processes, in_sequence, in_threads
from lfobench.schedule.jobs import Forecast, Schedule
from lfobench.source_code import ships

WAIT_SECONDS = 1.0


@dataclass
class Tally:
    """Result of the work.

    Attributes:
        failed: jobs that crashed.
        busy: runs that were left to another process.
        stopped: whether a stop was asked for before everything was done.
    """

    failed: int = 0
    busy: int = 0
    stopped: bool = False


class Watcher:
    """Sees what is carried out, and shows it if it likes; this one shows nothing."""

    def phase(self, what: str) -> AbstractContextManager[object]:
        """Something that takes a moment, for as long as the block lasts."""
        return nullcontext()

    def warn(self, warnings: Iterable[Warning]) -> None:
        """Remarks on the data, before anything trains on it."""

    def building(
        self, shards: Sequence[ShardJob | ImportJob], made: Iterator[ShardJob | ImportJob]
    ) -> Iterator[ShardJob | ImportJob]:
        """Every shard as it is made."""
        return made

    def training(self, schedule: Schedule, expected: Forecast, events: Iterator[Event]) -> Iterator[Event]:
        """Every event of the schedule's jobs as it comes."""
        return events

    def waiting(self, runs: int) -> None:
        """So many runs of another process are waited for; called whenever their number changes."""

    def failed(self, job: Job, ended: Ended, kept: Sequence[Path]) -> None:
        """A job crashed; what is known of it is kept in files."""


class Lines(Watcher):
    """A line of text for every run that is done and every job that is not.

    Args:
        show: called with each.

    Attributes:
        problems: lines of the jobs that did not end with their records.
    """

    def __init__(self, show: Callable[[str], object]) -> None:
        self._show = show
        self.problems: list[str] = []

    def training(self, schedule: Schedule, expected: Forecast, events: Iterator[Event]) -> Iterator[Event]:
        """The score of each run, as it is recorded."""
        for event in events:
            if isinstance(event.what, Recorded):
                self._show(f"{event.what.run}: score {event.what.score:.1f}")
            yield event

    def failed(self, job: Job, ended: Ended, kept: Sequence[Path]) -> None:
        """The cause."""
        self.problems.append(f"{job.cell.label}: {ended.message}")
        self._show(self.problems[-1])


class StopRequest:
    """Set by the first Ctrl-C, SIGTERM or SIGHUP; one more Ctrl-C ends the work at once.

    Args:
        announce: called once, when a stop is asked for.
    """

    def __init__(self, announce: Callable[[], None] = lambda: None) -> None:
        self.asked = False
        self._announce = announce

    def __call__(self) -> bool:
        """True if a stop was asked for."""
        return self.asked

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Handle signals inside the block, which a second Ctrl-C ends.

        Only the main thread can; in any other, nothing asks for a stop.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
        if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
            numbers.remove(signal.SIGHUP)  # as nohup asked for
        previous = {number: signal.signal(number, self._handle) for number in numbers}
        try:
            yield
        except KeyboardInterrupt:
            self.asked = True
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            # Schedulers and shells send theirs more than once, and mean the same.
            if number == signal.SIGINT:
                raise KeyboardInterrupt
            return
        self.asked = True
        self._announce()


def execute_schedule(
    schedule: Schedule, expected: Forecast, out: Path, stop: StopRequest, watcher: Watcher, wait: bool = True
) -> Tally:
    """Build the missing data, train the pending runs.

    Args:
        schedule: what is left to do.
        expected: how long it takes.
        out: the output folder.
        stop: says when to save and end.
        watcher: sees everything.
        wait: for runs that another process is training, and train them where it ends without their records.

    Raises:
        UserError: for data that is damaged, or a folder that cannot be written into or has no file locks.
    """
    plan = schedule.plan
    check_here(plan.tasks, plan.cells[0].suite, plan.cells[0].source)
    with watcher.phase("Checking the methods…"):
        check_methods(schedule.jobs)
    sources = {task.name: spelled(task, plan.cells[0].source) for task in plan.tasks}

    def rebuild(task: str) -> str:
        return build_command(plan.cells[0].suite, plan.protocol.name, task, sources[task])

    with watcher.phase("Checking the data…"):
        check_present(schedule.cache, schedule.requests, rebuild)
    if schedule.shards:
        writable_folder(schedule.cache, "LFOBENCH_CACHE")
    folder = RecordFolder(out)
    writable_folder(folder.checkpoints, "--out")
    with suppress(Held), locked(folder.checkpoints / "any.lock", "--out"):
        pass  # a file system without locks is named before anything trains
    tally = Tally()
    with stop.listening():
        build_data(schedule.shards, schedule.builders, stop, watcher)
        folder.remove_leftovers()
        if not stop():
            _check_data(schedule, rebuild, stop, watcher)
        if not stop():
            folder.set_aside(schedule.again)
            busy = _train(schedule, expected, folder, stop, watcher, tally)
            if wait:
                busy = _follow(schedule, expected, busy, folder, stop, watcher, tally)
            tally.busy = sum(len(job.seeds) for job in _unfinished(busy, folder))
    tally.stopped = stop()
    if not (tally.stopped or tally.failed or tally.busy):
        remove_checkpoints_of_the_finished(schedule, out)
    return tally


def check_methods(jobs: Sequence[Job]) -> None:
    """Check every method that does not ship with lfobench, in every configuration in which it is about to train.

    Raises:
        UserError: one breaks a rule of the contract.
    """
    checked: set[tuple[type[Method], str, str]] = set()
    for cell in (job.cell for job in jobs if not ships(job.cell.method)):
        key = (cell.method, cell.config.model_dump_json(), cell.task.environment.name)
        if key not in checked:
            checked.add(key)
            spaces = cell.task.environment.spaces
            require_sound(cell.method, cell.config, Shapes(spaces.observation, len(spaces.actions.low)))


def _check_data(schedule: Schedule, rebuild: Callable[[str], str], stop: StopRequest, watcher: Watcher) -> None:
    """Refuse files that nothing can be learned from, and say what is odd about data, before anything trains on it.

    Data that was generated for actions in [-1, 1] is not looked at: it takes long, and finds nothing.
    """
    cells: dict[str, list[Cell]] = {}
    for job in schedule.jobs:
        task = job.cell.task
        if task.read_from is not None or not task.environment.spaces.actions.is_unit:
            cells.setdefault(job.cell.task.name, []).append(job.cell)
    with watcher.phase("Looking at the data…"):
        for name, of_task in cells.items():
            if stop():
                return
            data = load_task(schedule.cache, schedule.plan.suite, of_task[0].task, of_task[0].recipe, rebuild(name))
            check_parts(data)
            for cell in of_task:
                watcher.warn(list(remarks(data, cell.needs)))


def remove_checkpoints_of_the_finished(schedule: Schedule, out: Path) -> None:
    """Delete what runs have left that were killed between writing their record and deleting checkpoint and lock."""
    folder = RecordFolder(out)
    for run in schedule.plan.runs:
        if folder.path(run).exists():
            with suppress(OSError):
                folder.checkpoint(run).unlink()
            if folder.lock(run).exists():
                # Whoever leaves a lock deletes its file; one that is held is somebody's.
                with suppress(Held, OSError), locked(folder.lock(run), "--out"):
                    pass


def build_data(
    shards: Sequence[ShardJob | ImportJob], workers: int, stop: Callable[[], bool], watcher: Watcher
) -> None:
    """Build shards; a stop leaves whole shards only."""
    if not shards:
        return
    remove_leftovers(shards[0].root / GENERATED)
    for _ in watcher.building(shards, build(shards, workers)):
        if stop():
            return


def _train(
    schedule: Schedule,
    expected: Forecast,
    folder: RecordFolder,
    stop: Callable[[], bool],
    watcher: Watcher,
    tally: Tally,
) -> list[Job]:
    """Carry out the schedule's jobs; returns what of them another process has."""
    own, busy = list(schedule.jobs), []
    for event in watcher.training(schedule, expected, _events(schedule.jobs, schedule.workers, stop)):
        job, what = own[event.index], event.what
        if isinstance(what, TrainedElsewhere):
            busy.append(replace(job, seeds=what.seeds))
            own[event.index] = replace(job, seeds=tuple(seed for seed in job.seeds if seed not in what.seeds))
        elif isinstance(what, Ended) and what.outcome == "failed":
            tally.failed += 1
            watcher.failed(job, what, list(_failure_reports(folder, job, what, watcher)))
    return busy


def _follow(
    schedule: Schedule,
    expected: Forecast,
    busy: Sequence[Job],
    folder: RecordFolder,
    stop: Callable[[], bool],
    watcher: Watcher,
    tally: Tally,
) -> list[Job]:
    """Wait for the runs of other processes, and train those that they let go without a record.

    Returns what a stop leaves of them.
    """
    reported = 0
    while (waiting := _unfinished(busy, folder)) and not stop():
        if (runs := sum(len(job.seeds) for job in waiting)) != reported:
            watcher.waiting(reported := runs)
        parts = [(job, [run.seed for run in job.runs if not is_held(folder.lock(run), "--out")]) for job in waiting]
        # Looked for once more: a run that is free may have been finished a moment ago.
        released = _unfinished([replace(job, seeds=tuple(free)) for job, free in parts if free], folder)
        if not released:
            busy = waiting
            time.sleep(WAIT_SECONDS)
            continue
        held = [
            replace(job, seeds=tuple(seed for seed in job.seeds if seed not in free))
            for job, free in parts
            if len(free) < len(job.seeds)
        ]
        taken = {run.identity_hash for job in released for run in job.runs}
        rest = replace(
            schedule, jobs=released, done=[run for run in schedule.plan.runs if run.identity_hash not in taken]
        )
        shares = replace(expected, job_seconds=[1.0 for _ in released])
        busy = [*held, *_train(rest, shares, folder, stop, watcher, tally)]
    return list(waiting)


def _unfinished(jobs: Sequence[Job], folder: RecordFolder) -> list[Job]:
    """Jobs with the seeds that have left no record."""
    parts = [(job, tuple(run.seed for run in job.runs if folder.find(run) is None)) for job in jobs]
    return [replace(job, seeds=seeds) for job, seeds in parts if seeds]


def _events(work: Sequence[Job], workers: int, stop: Callable[[], bool]) -> Iterator[Event]:
    if work and work[0].device == "cuda":
        return in_threads(work, run_job, workers, stop)
    if workers == 1 or len(work) == 1:
        return in_sequence(work, run_job, stop)
    return in_processes(work, run_job, workers, stop)


def _failure_reports(folder: RecordFolder, job: Job, ended: Ended, watcher: Watcher) -> Iterator[Path]:
    """Paths of the reports of a failed job, one per run without a record; a warning where one cannot be written."""
    for run in job.runs:
        if not folder.find(run):
            try:
                yield write_failure(folder, run, ended.message, ended.detail, ended.place)
            except UserError as error:
                what = f"{run.label} failed, of which nothing is kept: {error.problem}"
                watcher.warn([Warning(what=what, remedy=error.remedy)])
