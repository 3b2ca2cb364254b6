"""A job from data on disk to records on disk."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from filelock import FileLock, Timeout

from lfobench.contract.method import DataNeeds
from lfobench.contract.record import Evaluation, Record, Warning, content_hash
from lfobench.data.firewall import view
from lfobench.data.remarks import remarks
from lfobench.data.source import TaskData, load_task
from lfobench.engine.policy import save_policy
from lfobench.engine.provenance import package_versions, provenance
from lfobench.engine.training import Advance, Trainer
from lfobench.files import writable_folder
from lfobench.plan.cells import Cell, Run
from lfobench.plan.parts import build_command
from lfobench.plan.sources import spelled
from lfobench.processes import keep_freed_memory
from lfobench.registry import load_suite
from lfobench.store.folder import RecordFolder


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

    @cached_property
    def hash(self) -> str:
        """Names the checkpoint."""
        return content_hash([self.cell.identity, list(self.seeds)])


@dataclass(frozen=True)
class Recorded:
    """A run has left its record."""

    run: str
    path: Path
    score: float
    diverged: bool
    warnings: Sequence[Warning]


class Busy(Exception):
    """Another process is training this job."""


def carry_out(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
    """Train a job and write its records; ends early, with a checkpoint, when `stop` says so.

    Raises:
        Busy: when another process holds the job.
        UserError: for missing or damaged data, or a disk that refuses.
    """
    folder = RecordFolder(job.out)
    checkpoint = folder.checkpoint(job.hash)
    writable_folder(checkpoint.parent, "--out")
    try:
        with FileLock(checkpoint.with_suffix(".lock"), blocking=False):
            yield from _locked(job, folder, checkpoint, stop)
    except Timeout as error:
        raise Busy from error


def _locked(job: Job, folder: RecordFolder, checkpoint: Path, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
    if all(folder.find(run) for run in job.runs):
        checkpoint.with_suffix(".lock").unlink(missing_ok=True)
        return
    torch.set_num_threads(job.threads)
    keep_freed_memory()
    started = time.perf_counter()
    device = torch.device(job.device)
    cell = job.cell
    rebuild = build_command(cell.suite, cell.protocol.name, cell.task.name, spelled(cell.task, cell.source))
    data = load_task(job.cache, load_suite(cell.suite), cell.task, cell.recipe, rebuild)
    needs = cell.method.needs(cell.config)
    mixture = data.mixture(needs)
    inputs = {"data": data.fingerprints, "packages": package_versions()}
    seen = view(cell.method, needs, mixture, device)
    trainer = Trainer(cell, job.seeds, seen, device, inputs, checkpoint, stop, job.evaluators)
    loaded = time.perf_counter() - started
    yield from trainer.run()
    if not trainer.finished:
        return
    trainer.progress.seconds["load"] = loaded
    further = trainer.further()
    for index, run in enumerate(job.runs):
        if folder.find(run):
            continue
        record = _record(run, trainer, index, further[index], data, needs, device)
        if cell.starts == "evaluation":
            # The policy first: a record says that a run is done. Nobody looks at a trial's.
            save_policy(folder.policy(record), record, trainer.method, index, len(job.seeds), seen)
        path = folder.write(run, record)
        yield Recorded(run.label, path, record.score(), record.status == "diverged", trainer.warnings)
    checkpoint.unlink(missing_ok=True)
    checkpoint.with_suffix(".lock").unlink(missing_ok=True)


def _record(
    run: Run,
    trainer: Trainer,
    index: int,
    further: Evaluation | None,
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
        further=further,
        metrics=progress.metrics[index],
        tuning=run.cell.tuning,
        counts=data.counts(needs),
        warnings=[*_warnings(diverged_at, data, needs), *trainer.warnings],
        provenance=provenance(device, run.cell.precision, progress.seconds, data.fingerprints)
        | {
            "seeds_trained_together": len(progress.evaluations),
            "demonstration_score": data.demonstration_score,
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
