"""A job from data on disk to records on disk."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from lfobench.cells.cell import Cell, Run
from lfobench.cells.parts import build_command
from lfobench.cells.sources import spelled
from lfobench.contract.method import DataNeeds, Shapes
from lfobench.data.firewall import View, view
from lfobench.data.labels import LABEL, labels_of
from lfobench.data.remarks import remarks
from lfobench.data.source import TaskData, load_task
from lfobench.engine import checkpoint
from lfobench.engine.policy import save_policy
from lfobench.engine.provenance import package_versions, provenance
from lfobench.engine.state import MethodState, StateError, host
from lfobench.engine.training import Advance, Trainer
from lfobench.files import Held, locked, writable_folder
from lfobench.processes import keep_freed_memory
from lfobench.record import Evaluation, Record, Warning
from lfobench.records.folder import RecordFolder
from lfobench.registry import load_suite, package_of
from lfobench.source_code import check_unchanged, code_of
from lfobench.text import content_hash


@dataclass(frozen=True)
class Job:
    """Runs of one cell that train together.

    Attributes:
        cell: what to train.
        seeds: the seed axis.
        out: the output folder.
        cache: root of the dataset cache.
        device: ``cpu`` or ``cuda``.
        threads: of this process, for products on a CPU.
        evaluators: processes that evaluate beside training; 0 evaluates in the training process.
    """

    cell: Cell
    seeds: tuple[int, ...]
    out: Path
    cache: Path
    device: str
    threads: int = 1
    evaluators: int = 0

    @property
    def runs(self) -> list[Run]:
        """One per seed."""
        return [Run(self.cell, seed) for seed in self.seeds]


@dataclass(frozen=True)
class Recorded:
    """A run has left its record."""

    run: str
    path: Path
    score: float
    diverged: bool
    warnings: Sequence[Warning]


@dataclass(frozen=True)
class TrainedElsewhere:
    """Seeds of a job that another process is training; the first thing that is reported of it."""

    seeds: tuple[int, ...]


class Busy(Exception):
    """Another process is training a run of this job."""


def run_job(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded | TrainedElsewhere]:
    """Train a job and write its records; ends early, with checkpoints, when `stop` says so.

    Seeds that another process is training are left to it; the others train together, or in groups where their
    checkpoints stand at different steps.

    Raises:
        Busy: when another process holds any of the job's runs.
        UserError: for missing or damaged data, or a disk that refuses.
    """
    folder = RecordFolder(job.out)
    writable_folder(folder.checkpoints, "--out")
    with ExitStack() as held:
        free = [run for run in job.runs if _lock_taken(folder, run, held)]
        taken = {run.seed for run in free}
        if left := tuple(seed for seed in job.seeds if seed not in taken):
            yield TrainedElsewhere(left)
        pending = [run for run in free if not folder.find(run)]
        if pending:
            yield from _train(job, pending, folder, stop)
    if left:
        raise Busy


def _lock_taken(folder: RecordFolder, run: Run, held: ExitStack) -> bool:
    """Take a run's lock, if no other process has it."""
    try:
        held.enter_context(locked(folder.lock(run), "--out"))
    except Held:
        return False
    return True


@dataclass(frozen=True)
class _Resumed:
    """A run and its place among those of its job, the key of its checkpoint, and that checkpoint if there is one."""

    run: Run
    place: int
    key: str
    start: checkpoint.Checkpoint | None


def _train(
    job: Job, runs: Sequence[Run], folder: RecordFolder, stop: Callable[[], bool]
) -> Iterator[Advance | Recorded]:
    torch.set_num_threads(job.threads)
    keep_freed_memory()
    started = time.perf_counter()
    device = torch.device(job.device)
    cell = job.cell
    check_unchanged(cell.method, cell.code)
    rebuild = build_command(cell.suite, cell.protocol.name, cell.task.name, spelled(cell.task, cell.source))
    data = load_task(job.cache, load_suite(cell.suite), cell.task, cell.recipe, rebuild)
    needs = cell.needs
    mixture = data.mixture(needs)
    if LABEL in needs.offline:
        yield Advance(LABEL, 0, 1, None)
    try:
        labels = labels_of(
            cell.method,
            cell.config,
            needs,
            mixture,
            [run.seed for run in runs],
            device,
            code_of(cell.method),
            job.cache,
            partial(_check_stop, stop),
        )
    except _Stopped:
        return
    seen = view(cell.method, needs, mixture, device, labels)
    inputs = {"data": data.fingerprints, "packages": package_versions()}
    groups: dict[tuple[int, int], list[_Resumed]] = {}
    for index, run in enumerate(runs):
        key = content_hash([run.identity, device.type, inputs])
        saved = _fitting(run, seen.shapes, checkpoint.load(folder.checkpoint(run), key))
        place = (0, 0) if saved is None else saved.progress.place
        groups.setdefault(place, []).append(_Resumed(run, index, key, saved))
    together = [groups[place] for place in sorted(groups, reverse=True)]
    loaded = time.perf_counter() - started
    for index, group in enumerate(together):
        checkpoints = [(folder.checkpoint(each.run), each.key) for each in group]
        start = [each.start for each in group if each.start is not None]
        seeds = [each.run.seed for each in group]
        of_group = seen.of_seeds([each.place for each in group])
        trainer = Trainer(
            cell, seeds, of_group, device, checkpoints, start if len(start) == len(group) else (), stop, job.evaluators
        )
        for advance in trainer.run():
            yield replace(advance, done=index * advance.total + advance.done, total=len(together) * advance.total)
        if not trainer.finished:
            return
        trainer.progress.seconds["load"] = loaded
        yield from _write([each.run for each in group], trainer, folder, data, needs, seen, device)


def _fitting(run: Run, shapes: Shapes, saved: checkpoint.Checkpoint | None) -> checkpoint.Checkpoint | None:
    """A checkpoint that a method of this seed takes; None, so that the seed starts afresh, where it does not."""
    if saved is None:
        return None
    trial = run.cell.method(run.cell.config, shapes, [run.seed], host())
    try:
        MethodState.of(trial, shapes, 1).restore([saved.state])
    except StateError:
        return None
    return saved


class _Stopped(Exception):
    """A stop was asked for while labels were computed; they are computed again."""


def _check_stop(stop: Callable[[], bool], done: float) -> None:
    if stop():
        raise _Stopped


def _write(
    runs: Sequence[Run],
    trainer: Trainer,
    folder: RecordFolder,
    data: TaskData,
    needs: DataNeeds,
    seen: View,
    device: torch.device,
) -> Iterator[Recorded]:
    """The records of trained runs, and their policies."""
    final = trainer.final_evaluation()
    for index, run in enumerate(runs):
        record = _record(run, trainer, index, final[index], data, needs, device)
        if run.cell.starts == "evaluation":
            # The policy first: a record says that a run is done. Nobody looks at a trial's.
            save_policy(folder.policy(record), record, run.cell.method, trainer.state, index, seen)
        path = folder.write(run, record)
        folder.checkpoint(run).unlink(missing_ok=True)
        counted = record.bounded()
        warnings = [*trainer.warnings, *counted.warnings[len(record.warnings) :]]
        yield Recorded(run.label, path, counted.score(), counted.status == "diverged", warnings)


def _record(
    run: Run,
    trainer: Trainer,
    index: int,
    final: Evaluation | None,
    data: TaskData,
    needs: DataNeeds,
    device: torch.device,
) -> Record:
    progress = trainer.progress
    diverged_at = progress.diverged_at[index]
    return Record(
        identity_hash=run.identity_hash,
        identity=run.identity,
        labels=run.cell.labels,
        status="finished" if diverged_at is None else "diverged",
        diverged_at=diverged_at,
        evaluations=progress.evaluations[index],
        further=final,
        metrics=progress.metrics[index],
        tuning=run.cell.tuning,
        counts=data.counts(needs),
        warnings=[*_warnings(diverged_at, data, needs), *trainer.warnings],
        provenance=provenance(device, run.cell.precision, progress.seconds, data.fingerprints)
        | {
            "seeds_trained_together": len(progress.evaluations),
            "demonstration_score": data.demonstration_score,
            **({"method_package": package} if (package := package_of(run.cell.method)) else {}),
            **({"data_files": data.files} if data.files else {}),
            "gradient_steps": trainer.length,
        },
    )


def _warnings(diverged_at: int | None, data: TaskData, needs: DataNeeds) -> Iterator[Warning]:
    if diverged_at is not None:
        yield Warning(
            what=f"Non-finite values at step {diverged_at}: this seed counts as score 0.",
            remedy="Lower the learning rates or the temperature; the other seeds are unaffected.",
        )
    yield from remarks(data, needs)
