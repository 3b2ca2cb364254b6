"""Progress of long work: bars with an ETA on a terminal, a line now and then in a log."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from rich.progress import BarColumn, Progress, Task, TextColumn, TimeRemainingColumn
from rich.table import Column
from rich.text import Text

from lfobench.cli.console import INTERRUPTED, LEFT, duration, errors, one_line
from lfobench.cli.options import warn
from lfobench.data.build import ImportJob, ShardJob
from lfobench.engine.job import Job, Recorded
from lfobench.engine.training import Advance
from lfobench.record import Warning, usable
from lfobench.schedule.execution import StopRequest, Watcher, execute_schedule
from lfobench.schedule.executors import Ended, Event
from lfobench.schedule.jobs import Forecast, Schedule
from lfobench.text import counted, short_number

LOG_SECONDS = 60.0


class Display:
    """Progress lines of one stretch of work.

    Args:
        bars: what is drawn on a terminal; it also keeps the times where nothing is drawn.
        logging: whether to print lines in the place of bars.
    """

    def __init__(self, bars: Progress, logging: bool) -> None:
        self.bars = bars
        self._logging = logging
        self._next = time.monotonic() + LOG_SECONDS

    def tick(self) -> None:
        """Print the lines of the log that are due; called at every event."""
        if not self._logging or time.monotonic() < self._next:
            return
        self._next = time.monotonic() + LOG_SECONDS
        for task in self.bars.tasks:
            errors.print(_log_line(task), soft_wrap=True)


@contextmanager
def display(quiet: bool) -> Iterator[Display]:
    """Bars on a terminal, lines in a log, nothing if `quiet`."""
    bars = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=12),
        TextColumn("{task.fields[count]}", justify="right"),
        TextColumn("{task.fields[note]}"),
        # The time left is what narrow terminals must not cut.
        TimeRemainingColumn(table_column=Column(min_width=7, no_wrap=True)),
        TextColumn("left", table_column=Column(min_width=4, no_wrap=True)),
        console=errors,
        disable=quiet or not errors.is_terminal,
    )
    with bars:
        yield Display(bars, logging=not quiet and not errors.is_terminal)


def score_words(score: float) -> str:
    """``score 97.9``; an average that is beyond all measure is not spelled out."""
    return f"score {short_number(score)}" if usable(score) else "score exploded"


def _log_line(task: Task) -> Text:
    fields = [Text.from_markup(task.description).plain, task.fields["count"], task.fields["note"]]
    if task.time_remaining is not None:
        fields.append(f"about {duration(task.time_remaining)} left")
    return Text("  ".join(field for field in fields if field))


class OverallLine:
    """The progress line of everything, in expected seconds, so that its ETA weighs slow methods as slow."""

    def __init__(self, bars: Progress, schedule: Schedule, expected: Forecast) -> None:
        self._weights = expected.job_seconds
        self._fractions = [0.0] * len(schedule.jobs)
        self._bars, self._done, self._wanted = bars, len(schedule.done), len(schedule.plan.runs)
        self._task = bars.add_task("[bold]All runs[/]", total=sum(self._weights), count=self._count, note="runs done")

    @property
    def _count(self) -> str:
        return f"{self._done}/{self._wanted}"

    def advance(self, index: int, fraction: float) -> None:
        """Job `index` has done that part of its steps."""
        self._fractions[index] = fraction
        done = sum(weight * part for weight, part in zip(self._weights, self._fractions, strict=True))
        self._bars.update(self._task, completed=done)

    def recorded(self) -> None:
        """One more run has left its record."""
        self._done += 1
        self._bars.update(self._task, count=self._count)


class JobLine:
    """The progress line of one running job."""

    def __init__(self, bars: Progress, job: Job) -> None:
        self._bars = bars
        seeds = f"seed {job.seeds[0]}" if len(job.seeds) == 1 else f"{len(job.seeds)} seeds"
        self._task = bars.add_task(f"{one_line(job.cell.label)} {seeds}", total=None, count="", note="")

    def update(self, advance: Advance) -> None:
        """Show the job's stage, speed and latest score."""
        speed = self._bars.tasks[self._bars.task_ids.index(self._task)].speed
        rate = f", {speed:.0f} steps/s" if speed else ""
        score = "" if advance.score is None else f", {score_words(advance.score)}"
        note = f"{advance.stage}{rate}{score}"
        count = f"{advance.done}/{advance.total}"
        self._bars.update(self._task, total=advance.total, completed=advance.done, count=count, note=note)

    def remove(self) -> None:
        """The job is over."""
        self._bars.remove_task(self._task)


class Terminal(Watcher):
    """Shows work on standard error as it is carried out.

    Args:
        quiet: show nothing but jobs that fail.
    """

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._warned: set[Warning] = set()

    def phase(self, what: str) -> AbstractContextManager[object]:
        """A line that goes away."""
        return errors.status(what)

    def warn(self, warnings: Iterable[Warning]) -> None:
        """Print those that were not printed before."""
        new = [warning for warning in dict.fromkeys(warnings) if warning not in self._warned]
        if not self._quiet:
            warn(new)
        self._warned.update(new)

    def building(
        self, shards: Sequence[ShardJob | ImportJob], made: Iterator[ShardJob | ImportJob]
    ) -> Iterator[ShardJob | ImportJob]:
        """A bar of shards."""
        with display(self._quiet) as shown:
            task = shown.bars.add_task("Building data", total=len(shards), count=f"0/{len(shards)}", note="shards")
            for done, job in enumerate(made, start=1):
                note = f"{job.level} of {job.task}"
                shown.bars.update(task, completed=done, count=f"{done}/{len(shards)}", note=note)
                shown.tick()
                yield job
        if not self._quiet:
            errors.print(f"Built {counted(len(shards), 'shard')}.")

    def training(self, schedule: Schedule, expected: Forecast, events: Iterator[Event]) -> Iterator[Event]:
        """A bar of everything, one of every running job, a line for every record."""
        with display(self._quiet) as shown:
            overall = OverallLine(shown.bars, schedule, expected)
            lines: dict[int, JobLine] = {}
            for event in events:
                job, what = schedule.jobs[event.index], event.what
                if isinstance(what, Advance):
                    if event.index not in lines:
                        lines[event.index] = JobLine(shown.bars, job)
                    lines[event.index].update(what)
                    overall.advance(event.index, what.done / what.total)
                elif isinstance(what, Recorded):
                    overall.recorded()
                    mark = " [red]diverged[/]" if what.diverged else ""
                    if not self._quiet:
                        errors.print(f"{one_line(what.run)}: {score_words(what.score)}{mark}")
                    self.warn(what.warnings)
                elif isinstance(what, Ended) and (line := lines.pop(event.index, None)):
                    line.remove()
                yield event
                shown.tick()

    def waiting(self, runs: int) -> None:
        """One line."""
        if not self._quiet:
            errors.print(f"Waiting for {counted(runs, 'run')} of another process…")

    def failed(self, job: Job, ended: Ended, kept: Sequence[Path]) -> None:
        """One line, the user's own lines that it came from, and one for every file that holds a traceback."""
        errors.print(f"[bold red]Failed:[/] {one_line(f'{job.cell.label}: {ended.message}')}", soft_wrap=True)
        for line in ended.place:
            errors.print(f"        {one_line(line)}", soft_wrap=True)
        for path in kept if ended.detail else ():
            errors.print(f"        traceback in {one_line(str(path))}", soft_wrap=True)


def stopping() -> None:
    """Message when a stop is asked for."""
    errors.print("\nStopping: saving where every run stands. Press Ctrl-C again to quit at once.")


def carry_out(
    schedule: Schedule, expected: Forecast, out: Path, quiet: bool, wait: bool = True, again: str = "The same command"
) -> int:
    """Execute a schedule, shown on the terminal; returns the exit code.

    Args:
        schedule: the work.
        expected: how long it takes.
        out: the output folder.
        quiet: show nothing but jobs that fail.
        wait: for runs that another process is training.
        again: the command that goes on from where this one ends.

    Raises:
        UserError: for data that is damaged, or a folder that cannot be written into.
    """
    tally = execute_schedule(schedule, expected, out, StopRequest(stopping), Terminal(quiet), wait)
    if tally.stopped:
        errors.print(f"Stopped. {again} continues from here.")
        return INTERRUPTED
    if tally.failed:
        errors.print(f"[bold red]{tally.failed} failed.[/] {again} tries them again.")
        return 1
    if tally.busy:
        errors.print(f"{counted(tally.busy, 'run')} left to another process, which is training them.")
        return LEFT
    return 0
