"""The schedule: what is left of a plan, as jobs, and how long it will take on this machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lfobench.cells.cell import Run
from lfobench.cells.parts import SHARD_TRANSITIONS, FilePart, PartRequest, requests
from lfobench.cells.plan import Plan, Request, cuda_is_available, make_plan
from lfobench.contract.suite import Level, Operator
from lfobench.data.build import ImportJob, ShardJob, missing_shards
from lfobench.data.cache import PartCache
from lfobench.data.library import Library
from lfobench.data.remarks import unbounded_actions
from lfobench.engine.job import Job
from lfobench.errors import UserError
from lfobench.files import cache_folder
from lfobench.record import Warning
from lfobench.records.folder import RecordsRead
from lfobench.records.tuning import TuningFolder, with_choices

if TYPE_CHECKING:
    from lfobench.engine.probe import Prober

IMPORT_SECONDS = 3.0
"""Reading a file of some hundred megabytes; a guess, next to hours of training."""


@dataclass(frozen=True)
class Needs:
    """What a task still lacks of its data.

    Attributes:
        shards: to make, or to read from a file that is here.
        files: to fetch.
    """

    shards: int = 0
    files: tuple[str, ...] = ()


@dataclass(frozen=True)
class Schedule:
    """A plan and what is left of it.

    Attributes:
        plan: everything asked for.
        done: runs whose record is there.
        jobs: the others, grouped as they train together: on CUDA all seeds of a cell, on a CPU one by one, to be
            spread over processes.
        requests: the parts that the jobs read, by task.
        shards: what of those is still to build.
        cache: root of the dataset cache.
        workers: jobs that run at once: processes on a CPU, threads that share a CUDA device.
        builders: processes that build data.
        notes: what was changed to make the plan fit the machine.
        again: runs that were done before, whose records are set aside before anything trains.
    """

    plan: Plan
    done: Sequence[Run]
    jobs: Sequence[Job]
    requests: Sequence[tuple[str, PartRequest]]
    shards: Sequence[ShardJob | ImportJob]
    cache: Path
    workers: int
    builders: int
    notes: Sequence[Warning] = ()
    again: Sequence[Run] = ()

    @property
    def pending(self) -> list[Run]:
        """Runs still to do."""
        return [run for job in self.jobs for run in job.runs]

    @property
    def needs(self) -> dict[str, Needs]:
        """By task; those whose runs are all done lack nothing. Parts that tasks share are counted for each."""
        found = {task.name: Needs() for task in self.plan.tasks}
        for (task, _), request in {(task, each.specification.hash): each for task, each in self.requests}.items():
            part, before = request.specification, found[task]
            if isinstance(part, FilePart) and request.path is None:
                found[task] = replace(before, files=(*before.files, part.name))
            else:
                missing = len(PartCache(self.cache, part).missing(request.transitions))
                found[task] = replace(before, shards=before.shards + missing)
        return found


def resolve(wanted: Request, tuned_in: Path | None = None) -> Plan:
    """Names to cells, with the values chosen in the output folder `tuned_in` where one is given.

    Raises:
        UserError: for anything that does not exist or does not parse.
    """
    plan = make_plan(wanted, cuda_is_available, Library(cache_folder()).find)
    return plan if tuned_in is None else with_choices(plan, wanted, TuningFolder(tuned_in))


def make_schedule(plan: Plan, read: RecordsRead, out: Path, cache: Path, workers: int, rerun: bool = False) -> Schedule:
    """The schedule of a plan, given the records and the dataset cache; writes nothing.

    With `rerun`, what is done is done again.

    Raises:
        UserError: for a run whose records contradict each other; training it once more would settle nothing.
    """
    before = {record.identity_hash for record in read.records} | read.contradicted.keys()
    again = [run for run in plan.runs if rerun and run.identity_hash in before]
    read = read.without(again)
    for run in plan.runs:
        if paths := read.contradicted.get(run.identity_hash):
            raise UserError(
                f"{run.label} has records that contradict each other: {', '.join(map(str, paths))}.",
                "Keep the one you trust, or none to train it again.",
            )
    there = {record.identity_hash for record in read.records}
    done = [run for run in plan.runs if run.identity_hash in there]
    jobs = []
    for cell in plan.cells:
        seeds = tuple(seed for seed in plan.seeds if Run(cell, seed).identity_hash not in there)
        groups = [seeds] if plan.device == "cuda" else [(seed,) for seed in seeds]
        jobs += [Job(cell, group, out, cache, plan.device) for group in groups if group]
    cells = {job.cell.task.name: job.cell for job in jobs}
    wanted = [
        (name, request) for name, cell in cells.items() for request in requests(plan.suite, cell.task, cell.recipe)
    ]
    return Schedule(
        plan,
        done,
        jobs,
        wanted,
        missing_shards(cache, plan.cells[0].suite, wanted),
        cache,
        workers,
        workers,
        again=again,
    )


@dataclass(frozen=True)
class Forecast:
    """How long a schedule will take on this machine.

    Attributes:
        job_seconds: per job, were it alone on a core or device.
        total_seconds: data and jobs, spread over the workers.
        warnings: what the plan's reader should know, and what could not be measured. Such a job counts like the mean of
            the others, such data as nothing.
    """

    job_seconds: Sequence[float]
    total_seconds: float
    warnings: Sequence[Warning]


def forecast(schedule: Schedule, prober: Prober | None = None) -> Forecast:
    """Estimate every job from a short probe of this machine; a method or simulator that fails in it is a warning."""
    if prober is None:
        from lfobench.engine.probe import Prober

        prober = Prober(schedule.plan.device)
    problems: dict[str, str] = {}
    measured: list[float | None] = []
    for job in schedule.jobs:
        try:
            estimate = prober.estimate(job.cell, len(job.seeds), job.threads)
            measured.append(
                max(estimate.training, estimate.evaluation / job.evaluators) if job.evaluators else estimate.total
            )
        except UserError:
            raise
        except Exception as error:
            what = f"{job.cell.label} failed in the probe ({type(error).__name__}: {error})."
            problems[what] = "It will probably fail; the rest of the plan is unaffected."
            measured.append(None)
    known = [seconds for seconds in measured if seconds is not None]
    mean = sum(known) / len(known) if known else 1.0
    job_seconds = [mean if seconds is None else seconds for seconds in measured]
    building = sum(IMPORT_SECONDS for job in schedule.shards if isinstance(job, ImportJob))
    made = Counter((job.task, job.level) for job in schedule.shards if isinstance(job, ShardJob))
    for (task, level), shards in made.items():
        try:
            building += shards * _shard_seconds(schedule.plan, task, level, prober)
        except UserError:
            raise
        except Exception as error:
            what = f"The {level} data of {task} failed in the probe ({type(error).__name__}: {error})."
            problems[what] = "Nothing trains until all data is made: mend it, or leave the task out with --tasks."
    # Jobs that share a device were each measured alone on it.
    spread = sum(job_seconds) / (1 if schedule.plan.device == "cuda" else schedule.workers)
    data = building / min(schedule.builders, len(schedule.shards) or 1)
    warnings = [
        *(warning for task in schedule.plan.tasks for warning in unbounded_actions(task)),
        *schedule.notes,
        *(Warning(what=what, remedy=remedy) for what, remedy in problems.items()),
    ]
    return Forecast(job_seconds, data + max([spread, *job_seconds]), warnings)


def _shard_seconds(plan: Plan, task: str, level: Level, prober: Prober) -> float:
    environment = next(each for each in plan.tasks if each.name == task).environment
    assert plan.suite.demonstrator is not None, "what cannot be generated has no shard job"
    demonstrator = plan.suite.demonstrator(environment.name, level)
    if isinstance(demonstrator, Operator):
        return prober.recording(demonstrator)
    return SHARD_TRANSITIONS * prober.generation(environment)
