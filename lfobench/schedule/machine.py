"""The schedule fitted to the machine: jobs at once, and the seeds, threads and evaluators of each.

By rules of counts and sizes, never of measured times: a plan that is asked for twice is the same plan.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from lfobench.cells.plan import Plan
from lfobench.engine.job import Job
from lfobench.engine.memory import Footprint, Memory, fitting_groups, fitting_together, memory_of
from lfobench.errors import UserError
from lfobench.files import cache_folder
from lfobench.processes import available_cores
from lfobench.record import Warning
from lfobench.records.folder import RecordsRead
from lfobench.schedule.jobs import Schedule, make_schedule
from lfobench.source_code import in_session

if TYPE_CHECKING:
    from lfobench.engine.probe import Prober

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
