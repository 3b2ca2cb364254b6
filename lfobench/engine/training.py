"""The one training loop: every method, every seed, any protocol.

It trains seeds of a cell that stand at the same step, and yields its progress wherever something can be shown. It can
be stopped between any two yields, or killed at any instant; every seed continues from its own last checkpoint.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from lfobench.cells.cell import Cell
from lfobench.contract.method import Method, Stage
from lfobench.data.firewall import View
from lfobench.engine.batches import check_tables
from lfobench.engine.checkpoint import Checkpoint, Checkpoints, Progress, joined, joined_sums
from lfobench.engine.evaluations import Evaluations
from lfobench.engine.logging import log_metrics, mark_diverged
from lfobench.engine.program import Program, precision_warnings, recorder_for
from lfobench.engine.state import MethodState, host
from lfobench.errors import UserError
from lfobench.randomness import Randomness
from lfobench.record import Evaluation, Warning

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
        checkpoints: per seed, the file to save to and the key that hashes everything its numbers depend on.
        start: per seed, where to continue, all at the same step; empty to begin.
        stop: asked between steps; when it says True the job saves and ends without records.
        evaluators: processes that evaluate beside training; 0 evaluates in this one, in turn with it.

    Attributes:
        method: all seeds together.
        state: everything that training changes in it.
        progress: stage, step, evaluations and metrics so far.
        warnings: departures from the plan that change no number.
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
        self._cell, self._view, self._device, self._stop = cell, view, device, stop
        self._randomness = Randomness(seeds, device)
        self._checkpoints = Checkpoints(checkpoints)
        self.method: Method = cell.method(cell.config, view.shapes, list(seeds), device)
        self.state = MethodState.of(self.method, view.shapes, len(seeds))
        self.progress = joined([each.progress for each in start]) if start else Progress.start(len(seeds))
        self.warnings: list[Warning] = precision_warnings(cell.precision, device)
        if start:
            self.state.restore([each.state for each in start])
        self._resumed_sums = joined_sums(start)
        self._stages = self.method.stages(view.sizes)
        for stage in self._stages:
            if problem := check_tables(stage, view.offline, view.expert):
                raise UserError(
                    f"{cell.label} cannot train: {problem}.", "See 'lfobench show' for the recipe's counts."
                )
        # Last, because it starts worker processes and simulators, which only `run` closes.
        self._evaluations = Evaluations(cell, seeds, view, device, evaluators)

    def run(self) -> Iterator[Advance]:
        """Train to the end or to the stop; `progress` holds the result."""
        try:
            while not self.finished:
                stage = self._stages[self.progress.stage]
                yield from self._run_stage(stage, self._program(stage))
                if self.progress.step < self.steps_of(stage):
                    return
                self.progress.begin_stage(self.progress.stage + 1)
        finally:
            self._evaluations.close()

    def _run_stage(self, stage: Stage, program: Program) -> Iterator[Advance]:
        progress, length, shown = self.progress, self.steps_of(stage), time.monotonic()
        while progress.step < length:
            if self._stop():
                self._save(program)
                return
            self._update(program)
            at_evaluation = stage.steps is None and self._evaluation_due(length)
            if at_evaluation:
                self._evaluate(program)
            if self._checkpoints.due or (at_evaluation and self._evaluations.in_turn):
                self._save(program)
            if at_evaluation or time.monotonic() - shown > EVENT_SECONDS:
                shown = time.monotonic()
                self._evaluations.collect(progress, wait=False)
                yield self._advance(stage)
        self._evaluations.collect(progress, wait=True)
        if stage.steps is not None:
            self._log_metrics(program)
        if program.problem is not None:
            self.warnings.append(program.problem)
        if stage.steps is None and not self._evaluations.in_turn:
            yield self._advance(stage)

    @property
    def finished(self) -> bool:
        """True if every stage is complete."""
        return self.progress.stage == len(self._stages)

    @property
    def length(self) -> int:
        """Updates of all stages together."""
        return sum(self.steps_of(stage) for stage in self._stages)

    def steps_of(self, stage: Stage) -> int:
        """Length of a stage."""
        return self._cell.protocol.steps_for(self._cell.task) if stage.steps is None else stage.steps

    def final_evaluation(self) -> list[Evaluation | None]:
        """The final evaluation of every seed's trained policy, see `Evaluations.final`."""
        return self._evaluations.final(self.method, self.progress)

    def _program(self, stage: Stage) -> Program:
        """The stage's updates, with the sums of metrics that a checkpoint left."""
        program = Program(
            self.method,
            self._view,
            stage,
            self._randomness,
            precision=self._cell.precision,
            recorder=recorder_for(self._device),
        )
        program.add_to_metrics(self._resumed_sums)
        self._resumed_sums = {}
        return program

    def _update(self, program: Program) -> None:
        started = time.perf_counter()
        program.update(self.progress.step)
        self.progress.step += 1
        self.progress.seconds["train"] += time.perf_counter() - started

    def _evaluation_due(self, length: int) -> bool:
        step = self.progress.step
        return step % self._cell.protocol.evaluation_every == 0 or step == length

    def _evaluate(self, program: Program) -> None:
        started = time.perf_counter()
        self._log_metrics(program)
        mark_diverged(self.progress, self.state.finite())
        # Reading the metrics waited for the device, which was training until then.
        self.progress.seconds["train"] += time.perf_counter() - started
        self._evaluations.evaluate(self.method, self.state, self.progress)

    def _log_metrics(self, program: Program) -> None:
        """Turn the sums since the last row into one row of means per seed."""
        if not (sums := program.metric_sums()):
            return
        stage = self._stages[self.progress.stage]
        step, every = self.progress.step, self._cell.protocol.evaluation_every
        count = step if stage.steps is not None else (step % every or every)
        log_metrics(self.progress, stage.name, sums, count)
        program.clear_metrics()

    def _save(self, program: Program) -> None:
        self._evaluations.collect(self.progress, wait=True)
        self._checkpoints.save(self.progress, self.state.capture(host()), program.metric_sums())

    def _advance(self, stage: Stage) -> Advance:
        environment = self._cell.task.environment
        latest = [rows[-1].returns for rows in self.progress.evaluations if rows]
        scores = [environment.normalized_score(sum(returns) / len(returns)) for returns in latest]
        return Advance(
            stage=stage.name,
            done=sum(map(self.steps_of, self._stages[: self.progress.stage])) + self.progress.step,
            total=self.length,
            score=sum(scores) / len(scores) if scores else None,
        )
