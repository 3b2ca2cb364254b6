"""The one training loop: every method, every seed, any protocol.

It trains seeds of a cell that stand at the same step, and yields an event wherever something can be shown. It can be
stopped between any two events, or killed at any instant; every seed continues from its own last checkpoint.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from lfobench.cells.cell import Cell
from lfobench.contract.method import Method, Stage
from lfobench.data.firewall import View
from lfobench.engine import checkpoint
from lfobench.engine.batches import check_tables
from lfobench.engine.checkpoint import Checkpoint, Progress, joined
from lfobench.engine.evaluation import Evaluator, final_starts, fixed_starts
from lfobench.engine.evaluation_workers import EvaluationWorkers
from lfobench.engine.logging import log_evaluation, log_final_evaluation, log_metrics, mark_diverged
from lfobench.engine.program import Program, precision_warnings, recorder_for
from lfobench.engine.state import CPU, MethodState
from lfobench.errors import UserError
from lfobench.randomness import Randomness
from lfobench.record import Evaluation, Warning

CHECKPOINT_SECONDS = 120.0
EVENT_SECONDS = 0.5


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
        checkpoints: per seed, the file to save to and the key that says what its numbers depend on.
        start: per seed, where to continue, all at the same step; empty to begin.
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
        checkpoints: Sequence[tuple[Path, str]],
        start: Sequence[Checkpoint] = (),
        stop: Callable[[], bool] = lambda: False,
        evaluators: int = 0,
    ) -> None:
        self._cell, self._seeds, self._view, self._device = cell, list(seeds), view, device
        self._checkpoints, self._stop = list(checkpoints), stop
        self.method: Method = cell.method(cell.config, view.shapes, self._seeds, device)
        self._randomness = Randomness(self._seeds, device)
        self._stages = self.method.stages(view.sizes)
        self.state = MethodState.of(self.method, view.shapes, len(self._seeds))
        self._resumed_sums: dict[str, Tensor] = {}
        self._evaluator = Evaluator(cell.task, view.transform, len(self._seeds), fixed_starts(cell), cell.starts)
        self._beside = (
            EvaluationWorkers(cell, view.transform, view.shapes, self._seeds, evaluators) if evaluators else None
        )
        self.warnings: list[Warning] = precision_warnings(cell.precision, device)
        self.progress = Progress.start(len(self._seeds))
        if start:
            self._resume(start)
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
        mark_diverged(self.progress, step, self.state.finite())
        # Reading the metrics waited for the device, which was training until then.
        self.progress.seconds["train"] += time.perf_counter() - started
        if self._beside is not None:
            # One at a time: a queue of snapshots would only hide that evaluation is the bottleneck.
            self._settle(wait=True)
            self._beside.submit(step, self.state.capture(CPU))
            return
        started = time.perf_counter()
        log_evaluation(self.progress, step, self._evaluator.evaluate(self.method, self._device))
        self.progress.seconds["evaluate"] += time.perf_counter() - started

    def further(self) -> list[Evaluation | None]:
        """What the trained policies do from the further starts, per seed; None where there are none, or it diverged.

        A policy that answers one of them with something that is not finite has diverged, as in an evaluation.
        """
        nothing: list[Evaluation | None] = [None for _ in self._seeds]
        cell = self._cell
        starts = final_starts(cell)
        if not starts:
            return nothing
        started = time.perf_counter()
        evaluator = Evaluator(cell.task, self._view.transform, len(self._seeds), starts, cell.starts)
        try:
            results = evaluator.evaluate(self.method, self._device)
        finally:
            evaluator.close()
        self.progress.seconds["evaluate"] += time.perf_counter() - started
        return log_final_evaluation(self.progress, cell.protocol.steps_for(cell.task), results)

    def _settle(self, wait: bool) -> None:
        """Note the evaluations that workers have finished, or `wait` for all of them."""
        while self._beside is not None and self._beside.pending and (wait or self._beside.ready()):
            evaluated = self._beside.collect()
            self.progress.seconds["evaluate"] += evaluated.seconds
            log_evaluation(self.progress, evaluated.step, evaluated.results)

    def _write_metrics(self, program: Program) -> None:
        """Turn the sums since the last row into one row of means per seed."""
        sums = program.metric_sums()
        if not sums:
            return
        stage = self._stages[self.progress.stage]
        step, every = self.progress.step, self._cell.protocol.evaluation_every
        count = step if stage.steps is not None else (step % every or every)
        log_metrics(self.progress, stage.name, sums, count)
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
        sums = {name: total.cpu() for name, total in program.metric_sums().items()}
        for index, (state, (path, key)) in enumerate(zip(self.state.capture(CPU), self._checkpoints, strict=True)):
            of_seed = {name: total[index].clone() for name, total in sums.items()}
            checkpoint.save(path, key, Checkpoint(self.progress.of_seed(index), state, of_seed))

    def _resume(self, start: Sequence[Checkpoint]) -> None:
        """Continue from checkpoints of all seeds, which fit."""
        self.state.restore([each.state for each in start])
        self.progress = joined([each.progress for each in start])
        names = start[0].sums
        self._resumed_sums = {name: torch.stack([each.sums[name] for each in start]) for name in names}
