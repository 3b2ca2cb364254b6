"""The schedule: what is left of a plan, as jobs fitted to this machine, and how long they will take.

Jobs are arranged by counts and sizes, never by measured times: a plan that is asked for twice is the same plan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from lfobench.cells.cell import Run
from lfobench.cells.parts import SHARD_TRANSITIONS, FilePart, PartRequest, requests
from lfobench.cells.plan import Plan, Request, cuda_is_available, make_plan
from lfobench.contract.suite import Level, ScriptedDemonstrator
from lfobench.data.build import ImportJob, ShardJob, missing_shards
from lfobench.data.cache import PartCache
from lfobench.data.library import Library
from lfobench.data.remarks import unbounded_actions
from lfobench.engine.job import Job
from lfobench.engine.memory import Footprint, Memory, fitting_groups, fitting_together, memory_of
from lfobench.errors import UserError
from lfobench.files import cache_folder
from lfobench.processes import available_cores
from lfobench.record import Warning
from lfobench.records.folder import RecordsRead
from lfobench.records.tuning import TuningFolder, with_choices
from lfobench.source_code import in_session

if TYPE_CHECKING:
    from lfobench.engine.probe import Prober

IMPORT_SECONDS = 3.0
"""Reading a file of some hundred megabytes; a guess, next to hours of training."""


@dataclass(frozen=True)
class Needs:
    """Missing data of a task.

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
    """Estimated durations of a schedule on this machine.

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
    if isinstance(demonstrator, ScriptedDemonstrator):
        return prober.recording(demonstrator)
    return SHARD_TRANSITIONS * prober.generation(environment, demonstrator)


# Jobs that share a CUDA device: one keeps it busy, the others load, record and wait.
LANES = 3
# A worker process without its data; `ps` showed 390 MB for `run` itself, 500 to 530 MB for workers with `quick` data.
PROCESS_BYTES = 400 * 2**20
# Of one job on a CPU; the products of a step are too small to occupy more.
MOST_THREADS = 4


UNKNOWN = Memory(None, None)


def arranged(plan: Plan, read: RecordsRead, out: Path, workers: int | None, rerun: bool = False) -> Schedule:
    """The schedule of a plan on this machine by counts alone: at once, without measuring; writes nothing.

    Args:
        plan: everything asked for.
        read: the records that are there.
        out: the output folder.
        workers: jobs at once that the user asked for.
        rerun: whether what is done is to be done again.

    Raises:
        UserError: for a run whose records contradict each other.
    """
    schedule = make_schedule(plan, read, out, cache_folder(), workers or available_cores(), rerun)
    return packed(schedule, None, UNKNOWN, available_cores(), workers)


def within_memory(schedule: Schedule, workers: int | None) -> Schedule:
    """The same schedule with as much at once as this machine's memory holds, by one measured step per job's shapes.

    Raises:
        UserError: for a simulator that cannot be made.
    """
    from lfobench.engine.probe import Prober

    device = schedule.plan.device
    return packed(schedule, Prober(device), memory_of(torch.device(device)), available_cores(), workers)


def packed(schedule: Schedule, prober: Prober | None, memory: Memory, cores: int, workers: int | None) -> Schedule:
    """The same work, arranged for the machine.

    Args:
        schedule: what is left to do.
        prober: knows the sizes of jobs; None where they do not matter.
        memory: of the device.
        cores: of the processor.
        workers: jobs at once that the user asked for; None leaves the number to us.
    """
    if not schedule.jobs:
        return schedule
    on_cuda = schedule.plan.device == "cuda"
    here_only = {job.cell.method.name for job in schedule.jobs if in_session(job.cell.method)}
    # Threads of this process know what it knows; other processes do not.
    wanted = 1 if here_only and not on_cuda else workers or (LANES if on_cuda else cores)
    problems: dict[str, Warning] = {}
    footprints = [Footprint(0, 0) for _ in schedule.jobs]
    if prober is not None and memory != UNKNOWN:
        footprints = [_footprint(prober, job, on_cuda, problems) for job in schedule.jobs]
    jobs: list[Job] = []
    totals: list[int] = []
    split = 0
    for job, footprint in zip(schedule.jobs, footprints, strict=True):
        # By what the device has, not by what is free: on a GPU, groups of another size round otherwise.
        groups = fitting_groups(job.seeds, footprint, memory.capacity)
        split += len(groups) > 1
        jobs += [replace(job, seeds=group) for group in groups]
        totals += [footprint.total(len(group)) for group in groups]
    count = fitting_together(totals, memory.free, wanted)
    notes = [
        *_session_note(here_only),
        *_split_note(split, memory),
        *_fewer_notes(count, min(wanted, len(jobs)), memory, max(totals)),
    ]
    notes += problems.values()
    if on_cuda:
        beside = max(1, cores // count)
        jobs = [
            job if in_session(job.cell.method) else replace(job, evaluators=min(len(job.seeds), beside)) for job in jobs
        ]
    elif workers is None:
        jobs = [replace(job, threads=_threads(len(jobs), cores)) for job in jobs]
    return replace(schedule, jobs=jobs, workers=count, notes=notes)


def _threads(jobs: int, cores: int) -> int:
    """Threads per job where there are fewer jobs than cores: a power of two, by counting alone."""
    threads = 1
    while 2 * threads <= min(MOST_THREADS, cores // min(jobs, cores)):
        threads *= 2
    return threads


def _footprint(prober: Prober, job: Job, on_cuda: bool, problems: dict[str, Warning]) -> Footprint:
    try:
        footprint = prober.footprint(job.cell)
    except UserError:
        raise
    except Exception as error:
        footprint = Footprint(0, 0)
        problems[job.cell.label] = Warning(
            what=f"The memory of {job.cell.label} could not be measured ({type(error).__name__}: {error}).",
            remedy="It is planned as if it needed none: give --workers if memory is short.",
        )
    return footprint if on_cuda else replace(footprint, fixed=footprint.fixed + PROCESS_BYTES)


def _session_note(names: Collection[str]) -> list[Warning]:
    if not names:
        return []
    what = f"No other process can import the class of {', '.join(sorted(names))}, so everything runs in this one."
    return [Warning(what=what, remedy="No number changes; a class in a file that can be imported runs on all cores.")]


def _split_note(split: int, memory: Memory) -> list[Warning]:
    if not split or memory.capacity is None:
        return []
    what = f"{_gigabytes(memory.capacity)}, so the seeds of {split} cell{'s' if split > 1 else ''} train in groups."
    return [Warning(what=what, remedy="It takes longer; on a GPU, groups of another size round otherwise.")]


def _fewer_notes(count: int, wanted: int, memory: Memory, largest: int) -> list[Warning]:
    if memory.free is None:
        return []
    notes = []
    if count < wanted:
        what = f"{_gigabytes(memory.free)}, so {count} instead of {wanted} jobs run at once."
        notes.append(Warning(what=what, remedy="No number changes; it takes longer."))
    if largest > memory.free:
        what = f"One job needs about {largest / 2**30:.1f} GB, and {_gigabytes(memory.free)}."
        notes.append(Warning(what=what, remedy="It is tried; a smaller batch or protocol needs less."))
    return notes


def _gigabytes(size: int) -> str:
    return f"{size / 2**30:.1f} GB of memory may be used"
