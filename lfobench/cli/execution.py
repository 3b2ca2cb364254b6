"""Carrying out an agenda with progress on the terminal; Ctrl-C saves and says how to go on."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from lfobench.cli.console import errors
from lfobench.cli.planned import Agenda, Forecast
from lfobench.data.build import ShardJob, build
from lfobench.data.cache import GENERATED
from lfobench.engine.job import Job, Recorded, carry_out
from lfobench.engine.training import Advance
from lfobench.executors import local, pool
from lfobench.executors.events import Ended, Event
from lfobench.files import remove_leftovers, write_text
from lfobench.store.folder import RecordFolder

INTERRUPTED = 130


@dataclass
class Tally:
    """Jobs that did not end with their records."""

    failed: int = 0
    busy: int = 0

    def count(self, ended: Ended) -> None:
        """Add one ended job."""
        self.failed += ended.outcome == "failed"
        self.busy += ended.outcome == "busy"


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
    """Build the missing data, train the pending runs; returns the exit code."""
    stop = StopRequest()
    try:
        with stop.listening():
            build_data(agenda.shards, agenda.workers, stop, quiet)
            RecordFolder(out).remove_leftovers()
            tally = Tally() if stop() else _train(jobs(agenda, out), agenda, expected, out, stop, quiet)
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
        errors.print(f"{tally.busy} left to the other process that is training them; nothing else is missing.")
        return 0
    if not quiet:
        errors.print(f"Done. Next: lfobench table --out {escape(str(out))}", soft_wrap=True)
    return 0


def jobs(agenda: Agenda, out: Path) -> list[Job]:
    """On CUDA one job per cell with all its seeds; on a CPU one per run, to be spread over processes."""
    found = []
    for cell in agenda.plan.cells:
        seeds = agenda.pending_seeds(cell)
        groups = [seeds] if agenda.plan.device == "cuda" else [(seed,) for seed in seeds]
        found += [Job(cell, group, out, agenda.cache, agenda.plan.device) for group in groups if group]
    return found


def _bar(quiet: bool) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.fields[count]}", justify="right"),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(elapsed_when_finished=False),
        console=errors,
        disable=quiet or not errors.is_terminal,
    )


def build_data(shards: Sequence[ShardJob], workers: int, stop: StopRequest, quiet: bool = False) -> None:
    """Build shards with a progress bar; a stop leaves whole shards only."""
    if not shards:
        return
    remove_leftovers(shards[0].root / GENERATED)
    with _bar(quiet) as bar:
        task = bar.add_task("Building data", total=len(shards), count=f"0/{len(shards)}", note="shards")
        for done, job in enumerate(build(shards, workers), start=1):
            bar.update(task, completed=done, count=f"{done}/{len(shards)}", note=f"{job.level} of {job.task}")
            if stop():
                return
    if not quiet:
        errors.print(f"Built {len(shards)} shards.")


def _train(work: Sequence[Job], agenda: Agenda, expected: Forecast, out: Path, stop: StopRequest, quiet: bool) -> Tally:
    tally = Tally()
    with _bar(quiet) as bar:
        overall = _OverallLine(bar, work, agenda, expected)
        lines: dict[int, _JobLine] = {}
        for event in _events(work, agenda.workers, stop):
            job, what = work[event.index], event.what
            if isinstance(what, Advance):
                if event.index not in lines:
                    lines[event.index] = _JobLine(bar, job)
                lines[event.index].update(what)
                overall.advance(event.index, what.done / what.total)
            elif isinstance(what, Recorded):
                overall.recorded()
                mark = " [red]diverged[/]" if what.diverged else ""
                if not quiet:
                    errors.print(f"{escape(what.run)}: score {what.score:.1f}{mark}")
            else:
                if line := lines.pop(event.index, None):
                    line.remove()
                tally.count(what)
                _report(what, job, out)
    return tally


class _OverallLine:
    """The progress line of everything, in expected seconds, so that its ETA weighs slow methods as slow."""

    def __init__(self, bar: Progress, work: Sequence[Job], agenda: Agenda, expected: Forecast) -> None:
        seconds = dict(zip((run.identity_hash for run in agenda.pending), expected.run_seconds, strict=True))
        self._weights = [sum(seconds[run.identity_hash] for run in job.runs) for job in work]
        self._fractions = [0.0] * len(work)
        self._bar, self._done, self._wanted = bar, len(agenda.done), len(agenda.plan.runs)
        self._task = bar.add_task("[bold]All runs", total=sum(self._weights), count=self._count, note="runs done")

    @property
    def _count(self) -> str:
        return f"{self._done}/{self._wanted}"

    def advance(self, index: int, fraction: float) -> None:
        self._fractions[index] = fraction
        done = sum(weight * part for weight, part in zip(self._weights, self._fractions, strict=True))
        self._bar.update(self._task, completed=done)

    def recorded(self) -> None:
        self._done += 1
        self._bar.update(self._task, count=self._count)


def _events(work: Sequence[Job], workers: int, stop: StopRequest) -> Iterator[Event]:
    if workers == 1 or len(work) == 1:
        return local.execute(work, carry_out, stop)
    return pool.execute(work, carry_out, workers, stop)


class _JobLine:
    """The progress line of one running job."""

    def __init__(self, bar: Progress, job: Job) -> None:
        self._bar = bar
        seeds = f"seed {job.seeds[0]}" if len(job.seeds) == 1 else f"{len(job.seeds)} seeds"
        self._task = bar.add_task(f"{escape(job.cell.label)} {seeds}", total=None, count="", note="")

    def update(self, advance: Advance) -> None:
        speed = self._bar.tasks[self._bar.task_ids.index(self._task)].speed
        rate = f", {speed:.0f} steps/s" if speed else ""
        score = "" if advance.score is None else f", score {advance.score:.1f}"
        note = f"{advance.stage}{rate}{score}"
        count = f"{advance.done}/{advance.total}"
        self._bar.update(self._task, total=advance.total, completed=advance.done, count=count, note=note)

    def remove(self) -> None:
        self._bar.remove_task(self._task)


def _report(ended: Ended, job: Job, out: Path) -> None:
    if ended.outcome == "busy":
        errors.print(f"{escape(job.cell.label)}: skipped, {ended.message}.")
    if ended.outcome != "failed":
        return
    errors.print(f"[bold red]Failed:[/] {escape(job.cell.label)}: {escape(ended.message)}", soft_wrap=True)
    if ended.detail:
        path = RecordFolder(out).failure(job.runs[0])
        write_text(path, ended.detail)
        errors.print(f"        traceback in {escape(str(path))}", soft_wrap=True)
