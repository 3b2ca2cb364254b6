"""Carrying out an agenda with progress on the terminal; Ctrl-C saves and says how to go on."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from rich.markup import escape

from lfobench.cli.agenda import Agenda, Forecast
from lfobench.cli.console import INTERRUPTED, errors
from lfobench.cli.inputs import warn
from lfobench.cli.progress import JobLine, OverallLine, display
from lfobench.contract.record import Warning
from lfobench.data.build import ImportJob, ShardJob, build, check_present
from lfobench.data.cache import GENERATED
from lfobench.data.remarks import check_parts, remarks
from lfobench.data.source import load_task
from lfobench.engine.job import Job, Recorded, carry_out
from lfobench.engine.training import Advance
from lfobench.executors import lanes, local, pool
from lfobench.executors.events import Ended, Event
from lfobench.files import remove_leftovers, writable_folder
from lfobench.plan.cells import Cell, Run
from lfobench.plan.parts import build_command
from lfobench.plan.sources import check_here, spelled
from lfobench.store.failures import write_failure
from lfobench.store.folder import RecordFolder
from lfobench.words import counted


@dataclass
class Tally:
    """Jobs that did not end with their records."""

    failed: int = 0
    busy: int = 0

    def count(self, ended: Ended) -> None:
        """Add one ended job."""
        self.failed += ended.outcome == "failed"
        self.busy += ended.outcome == "busy"


class Said:
    """Warnings of records, each printed once."""

    def __init__(self) -> None:
        self._before: set[Warning] = set()

    def warn(self, warnings: Sequence[Warning]) -> None:
        """Print those that were not printed before."""
        warn(warning for warning in warnings if warning not in self._before)
        self._before.update(warnings)


class StopRequest:
    """Set by the first Ctrl-C or SIGTERM; the second ends the process at once."""

    def __init__(self) -> None:
        self.asked = False

    def __call__(self) -> bool:
        """Whether a stop was asked for."""
        return self.asked

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Handle signals inside the block."""
        previous = {number: signal.signal(number, self._handle) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        errors.print("\nStopping: saving where every run stands. Press Ctrl-C again to quit at once.")


def carry_out_agenda(agenda: Agenda, expected: Forecast, out: Path, quiet: bool) -> int:
    """Build the missing data, train the pending runs; returns the exit code.

    Raises:
        UserError: for data that is damaged, or a folder that cannot be written into.
    """
    plan = agenda.plan
    check_here(plan.tasks, plan.cells[0].suite, plan.cells[0].source)
    sources = {task.name: spelled(task, plan.cells[0].source) for task in plan.tasks}

    def rebuild(task: str) -> str:
        return build_command(plan.cells[0].suite, plan.protocol.name, task, sources[task])

    with errors.status("Checking the data…"):
        check_present(agenda.cache, agenda.requests, rebuild)
    if agenda.shards:
        writable_folder(agenda.cache, "LFOBENCH_CACHE")
    writable_folder(out, "--out")
    stop, said = StopRequest(), Said()
    try:
        with stop.listening():
            build_data(agenda.shards, agenda.builders, stop, quiet)
            RecordFolder(out).remove_leftovers()
            if not stop():
                _look_at_files(agenda, rebuild, said, stop, quiet)
            tally = Tally() if stop() else _train(agenda, expected, out, stop, said, quiet)
    except KeyboardInterrupt:
        stop.asked = True
        tally = Tally()
    if stop():
        errors.print("Stopped. The same command continues from here.")
        return INTERRUPTED
    if tally.failed:
        errors.print(f"[bold red]{tally.failed} failed.[/] The same command tries them again.")
        return 1
    if tally.busy:
        errors.print(f"{tally.busy} left to the other process that is training them. Run again to see them done.")
        return 1
    remove_checkpoints_of_the_finished(agenda, out)
    return 0


def _look_at_files(agenda: Agenda, rebuild: Callable[[str], str], said: Said, stop: StopRequest, quiet: bool) -> None:
    """Refuse files that nothing can be learned from, and say what they lack, before anything trains on them."""
    cells: dict[str, list[Cell]] = {}
    for job in agenda.jobs:
        if job.cell.task.read_from is not None:
            cells.setdefault(job.cell.task.name, []).append(job.cell)
    with errors.status("Looking at the files…"):
        for name, of_task in cells.items():
            if stop():
                return
            data = load_task(agenda.cache, agenda.plan.suite, of_task[0].task, of_task[0].recipe, rebuild(name))
            check_parts(data)
            for cell in of_task if not quiet else ():
                said.warn(list(remarks(data, cell.method.needs(cell.config))))


def remove_checkpoints_of_the_finished(agenda: Agenda, out: Path) -> None:
    """Delete what jobs left that were killed between two records, or between the last one and their checkpoint's end.

    Records are written in the order of the seeds, so what is left of a job trains as another one, and nobody else would
    ever look at its checkpoint.
    """
    plan, folder = agenda.plan, RecordFolder(out)
    for cell in plan.cells:
        if not all(folder.path(Run(cell, seed)).exists() for seed in plan.seeds):
            continue
        remainders = {plan.seeds[first:] for first in range(len(plan.seeds))}
        for seeds in remainders | {(seed,) for seed in plan.seeds}:
            with suppress(OSError):
                folder.checkpoint(Job(cell, seeds, out, agenda.cache, plan.device).hash).unlink()


def build_data(shards: Sequence[ShardJob | ImportJob], workers: int, stop: StopRequest, quiet: bool = False) -> None:
    """Build shards with a progress bar; a stop leaves whole shards only."""
    if not shards:
        return
    remove_leftovers(shards[0].root / GENERATED)
    with display(quiet) as shown:
        task = shown.bars.add_task("Building data", total=len(shards), count=f"0/{len(shards)}", note="shards")
        for done, job in enumerate(build(shards, workers), start=1):
            note = f"{job.level} of {job.task}"
            shown.bars.update(task, completed=done, count=f"{done}/{len(shards)}", note=note)
            shown.tick()
            if stop():
                return
    if not quiet:
        errors.print(f"Built {counted(len(shards), 'shard')}.")


def _train(agenda: Agenda, expected: Forecast, out: Path, stop: StopRequest, said: Said, quiet: bool) -> Tally:
    tally, work = Tally(), agenda.jobs
    with display(quiet) as shown:
        overall = OverallLine(shown.bars, agenda, expected)
        lines: dict[int, JobLine] = {}
        for event in _events(work, agenda.workers, stop):
            job, what = work[event.index], event.what
            if isinstance(what, Advance):
                if event.index not in lines:
                    lines[event.index] = JobLine(shown.bars, job)
                lines[event.index].update(what)
                overall.advance(event.index, what.done / what.total)
            elif isinstance(what, Recorded):
                overall.recorded()
                mark = " [red]diverged[/]" if what.diverged else ""
                if not quiet:
                    errors.print(f"{escape(what.run)}: score {what.score:.1f}{mark}")
                    said.warn(what.warnings)
            else:
                if line := lines.pop(event.index, None):
                    line.remove()
                tally.count(what)
                _report(what, job, out)
            shown.tick()
    return tally


def _events(work: Sequence[Job], workers: int, stop: StopRequest) -> Iterator[Event]:
    if work and work[0].device == "cuda":
        return lanes.execute(work, carry_out, workers, stop)
    if workers == 1 or len(work) == 1:
        return local.execute(work, carry_out, stop)
    return pool.execute(work, carry_out, workers, stop)


def _report(ended: Ended, job: Job, out: Path) -> None:
    if ended.outcome == "busy":
        errors.print(f"{escape(', '.join(run.label for run in job.runs))}: skipped, {ended.message}.")
    if ended.outcome != "failed":
        return
    errors.print(f"[bold red]Failed:[/] {escape(job.cell.label)}: {escape(ended.message)}", soft_wrap=True)
    if ended.detail:
        folder = RecordFolder(out)
        for run in job.runs:
            if not folder.find(run):
                path = write_failure(folder, run, ended.message, ended.detail)
                errors.print(f"        traceback in {escape(str(path))}", soft_wrap=True)
