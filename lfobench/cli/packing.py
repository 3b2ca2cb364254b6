"""Fitting an agenda to the machine: how many jobs at once, with how many seeds, threads and evaluators each."""

from __future__ import annotations

from dataclasses import replace

from lfobench.cli.agenda import Agenda
from lfobench.contract.record import Warning
from lfobench.engine.job import Job
from lfobench.engine.memory import Footprint, Memory, fitting_groups, fitting_together
from lfobench.engine.probe import Prober
from lfobench.errors import UserError

# Jobs that share a CUDA device: one keeps it busy, the others load, record and wait.
LANES = 3
# A worker process without its data; `ps` showed 390 MB for `run` itself, 500 to 530 MB for workers with `quick` data.
PROCESS_BYTES = 400 * 2**20


def packed(agenda: Agenda, prober: Prober, memory: Memory, cores: int, workers: int | None) -> Agenda:
    """The same work, arranged for the machine.

    Args:
        agenda: what is left to do.
        prober: measures steps and sizes.
        memory: of the device.
        cores: of the processor.
        workers: jobs at once that the user asked for; None leaves the number to us.
    """
    if not agenda.jobs:
        return agenda
    on_cuda = agenda.plan.device == "cuda"
    problems: dict[str, Warning] = {}
    footprints = [_footprint(prober, job, on_cuda, problems) for job in agenda.jobs]
    jobs: list[Job] = []
    totals: list[int] = []
    split = 0
    for job, footprint in zip(agenda.jobs, footprints, strict=True):
        # By what the device has, not by what is free: the groups name the checkpoints that the next command looks for.
        groups = fitting_groups(job.seeds, footprint, memory.capacity)
        split += len(groups) > 1
        jobs += [replace(job, seeds=group) for group in groups]
        totals += [footprint.total(len(group)) for group in groups]
    wanted = workers or (LANES if on_cuda else cores)
    count = fitting_together(totals, memory.free, wanted)
    notes = [*_split_note(split, memory), *_fewer_notes(count, min(wanted, len(jobs)), memory, max(totals))]
    notes += problems.values()
    if on_cuda:
        jobs = [replace(job, evaluators=min(len(job.seeds), max(1, cores // count))) for job in jobs]
    elif (spare := cores // count) > 1 and workers is None:
        jobs = [replace(job, threads=_threads(prober, job, spare)) for job in jobs]
    return replace(agenda, jobs=jobs, workers=count, notes=notes)


def _threads(prober: Prober, job: Job, most: int) -> int:
    try:
        return prober.threads(job.cell, most)
    except UserError:
        raise
    except Exception:
        return 1  # the forecast measures the same step and says what failed


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
