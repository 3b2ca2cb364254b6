"""The one training loop: every method, every seed, any protocol.

A job is a cell and some of its seeds. It yields an event at every point where something can be shown, and ends by
yielding one record per seed. It can be stopped between any two events, or killed at any instant, and continues
from its last checkpoint.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from lfobench.contract.method import Method, Stage
from lfobench.contract.randomness import Randomness
from lfobench.contract.record import Evaluation, Warning, content_hash
from lfobench.data.firewall import View
from lfobench.engine import checkpoint
from lfobench.engine.checkpoint import Progress
from lfobench.engine.evaluation import Evaluator, fixed_starts, further_starts
from lfobench.engine.evaluation_workers import EvaluationWorkers
from lfobench.engine.noting import mark_diverged, note_evaluation, note_further, note_metrics
from lfobench.engine.precision import precision_warnings
from lfobench.engine.program import Program, recorder_for
from lfobench.engine.sampling import check_tables
from lfobench.errors import UserError
from lfobench.plan.cells import Cell

CHECKPOINT_SECONDS = 120.0
EVENT_SECONDS = 0.5
METRIC_PREFIX = "metric: "


@dataclass(frozen=True)
class Advance:
    """A job's progress: updates done out of all stages, and the mean score of its latest evaluation."""

    stage: str
    done: int
    total: int
    score: float | None


class Trainer:
    """One job.

    Args:
        cell: what to train.
        seeds: the seed axis.
        view: the data, behind the firewall.
        device: where to train.
        inputs: what else decides the numbers, as JSON data; a checkpoint made under other inputs is not continued.
        checkpoint_path: where to continue from and save to.
        stop: asked between steps; when it says True the job saves and ends without records.
        evaluators: processes that evaluate beside training; 0 evaluates in this one, in turn with it.

    Attributes:
        warnings: what went other than planned, and changes no number.
    """

    def __init__(
        self,
        cell: Cell,
        seeds: Sequence[int],
        view: View,
        device: torch.device,
        inputs: Mapping[str, Any],
        checkpoint_path: Path,
        stop: Callable[[], bool] = lambda: False,
        evaluators: int = 0,
    ) -> None:
        self._cell, self._seeds, self._view, self._device = cell, list(seeds), view, device
        self._path, self._stop = checkpoint_path, stop
        self.method: Method = cell.method(cell.config, view.shapes, self._seeds, device)
        self._randomness = Randomness(self._seeds, device)
        self._stages = self.method.stages(view.sizes)
        self._job = content_hash([cell.identity, self._seeds, device.type, inputs])
        self._resumed_sums: dict[str, Tensor] = {}
        self._evaluator = Evaluator(cell.task, view.transform, len(self._seeds), fixed_starts(cell), cell.starts)
        self._beside = (
            EvaluationWorkers(cell, view.transform, view.shapes, self._seeds, evaluators) if evaluators else None
        )
        self.warnings: list[Warning] = precision_warnings(cell.precision, device)
        self.progress = Progress.start(len(self._seeds))
        for stage in self._stages:
            if problem := check_tables(stage, view.offline, view.expert):
                raise UserError(
                    f"{cell.label} cannot train: {problem}.", "See 'lfobench show' for the recipe's counts."
                )

    def steps_of(self, stage: Stage) -> int:
        """Length of a stage."""
        return self._cell.protocol.steps_for(self._cell.task) if stage.steps is None else stage.steps

    @property
    def length(self) -> int:
        """Updates of all stages together."""
        return sum(self.steps_of(stage) for stage in self._stages)

    def run(self) -> Iterator[Advance]:
        """Train to the end or to the stop; `progress` holds the result."""
        self._resume()
        try:
            while self.progress.stage < len(self._stages):
                stage = self._stages[self.progress.stage]
                program = Program(
                    self.method,
                    self._view,
                    stage,
                    self._randomness,
                    precision=self._cell.precision,
                    recorder=recorder_for(self._device),
                )
                program.add_to_metrics(self._resumed_sums)
                yield from self._run_stage(stage, program)
                if self.progress.step < self.steps_of(stage):
                    return
                self._resumed_sums = {}
                self.progress.stage, self.progress.step = self.progress.stage + 1, 0
        finally:
            self._evaluator.close()
            if self._beside is not None:
                self._beside.close()

    def _run_stage(self, stage: Stage, program: Program) -> Iterator[Advance]:
        saved = shown = time.monotonic()
        length = self.steps_of(stage)
        while self.progress.step < length:
            if self._stop():
                self._save(program)
                return
            self._update(program)
            at_evaluation = stage.steps is None and self._evaluation_due(length)
            if at_evaluation:
                self._evaluate(program)
            now = time.monotonic()
            if now - saved > CHECKPOINT_SECONDS or (at_evaluation and self._beside is None):
                self._save(program)
                saved = now
            if at_evaluation or now - shown > EVENT_SECONDS:
                shown = now
                self._settle(wait=False)
                yield self._advance(stage)
        self._settle(wait=True)
        if stage.steps is not None:
            self._write_metrics(program)
        if program.problem is not None:
            self.warnings.append(program.problem)
        if stage.steps is None and self._beside is not None:
            yield self._advance(stage)

    @property
    def finished(self) -> bool:
        """Whether every stage is complete."""
        return self.progress.stage == len(self._stages)

    def _update(self, program: Program) -> None:
        started = time.perf_counter()
        program.update(self.progress.step)
        self.progress.step += 1
        self.progress.seconds["train"] += time.perf_counter() - started

    def _evaluation_due(self, length: int) -> bool:
        step = self.progress.step
        return step % self._cell.protocol.evaluation_every == 0 or step == length

    def _evaluate(self, program: Program) -> None:
        step = self.progress.step
        started = time.perf_counter()
        self._write_metrics(program)
        mark_diverged(self.progress, step, self.method.state())
        # Reading the metrics waited for the device, which was training until then.
        self.progress.seconds["train"] += time.perf_counter() - started
        if self._beside is not None:
            # One at a time: a queue of snapshots would only hide that evaluation is the bottleneck.
            self._settle(wait=True)
            self._beside.submit(step, self.method.state())
            return
        started = time.perf_counter()
        note_evaluation(self.progress, step, self._evaluator.evaluate(self.method, self._device))
        self.progress.seconds["evaluate"] += time.perf_counter() - started

    def further(self) -> list[Evaluation | None]:
        """What the trained policies do from the further starts, per seed; None where there are none, or it diverged.

        A policy that answers one of them with something that is not finite has diverged, as in an evaluation.
        """
        nothing: list[Evaluation | None] = [None for _ in self._seeds]
        cell = self._cell
        starts = further_starts(cell)
        if not starts:
            return nothing
        started = time.perf_counter()
        evaluator = Evaluator(cell.task, self._view.transform, len(self._seeds), starts, cell.starts)
        try:
            results = evaluator.evaluate(self.method, self._device)
        finally:
            evaluator.close()
        self.progress.seconds["evaluate"] += time.perf_counter() - started
        return note_further(self.progress, cell.protocol.steps_for(cell.task), results)

    def _settle(self, wait: bool) -> None:
        """Note the evaluations that workers have finished, or `wait` for all of them."""
        while self._beside is not None and self._beside.pending and (wait or self._beside.ready()):
            evaluated = self._beside.collect()
            self.progress.seconds["evaluate"] += evaluated.seconds
            note_evaluation(self.progress, evaluated.step, evaluated.results)

    def _write_metrics(self, program: Program) -> None:
        """Turn the sums since the last row into one row of means per seed."""
        sums = program.metric_sums()
        if not sums:
            return
        stage = self._stages[self.progress.stage]
        step, every = self.progress.step, self._cell.protocol.evaluation_every
        count = step if stage.steps is not None else (step % every or every)
        note_metrics(self.progress, stage.name, sums, count)
        program.clear_metrics()

    def _advance(self, stage: Stage) -> Advance:
        lengths = [self.steps_of(stage) for stage in self._stages]
        scores = [
            self._cell.task.environment.normalized_score(sum(rows[-1].returns) / len(rows[-1].returns))
            for rows in self.progress.evaluations
            if rows
        ]
        return Advance(
            stage=stage.name,
            done=sum(lengths[: self.progress.stage]) + self.progress.step,
            total=self.length,
            score=sum(scores) / len(scores) if scores else None,
        )

    def _save(self, program: Program) -> None:
        self._settle(wait=True)
        sums = {METRIC_PREFIX + name: total for name, total in program.metric_sums().items()}
        checkpoint.save(self._path, self._job, self.progress, {**self.method.state(), **sums})

    def _resume(self) -> None:
        if resumed := checkpoint.load(self._path, self._job, self.method.state()):
            self.progress, sums = resumed
            self._resumed_sums = {name.removeprefix(METRIC_PREFIX): total for name, total in sums.items()}
