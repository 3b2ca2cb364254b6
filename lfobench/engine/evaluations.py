"""The evaluations of one job: in this process, in turn with training, or in worker processes while it goes on."""

from __future__ import annotations

import time
from collections.abc import Sequence

import torch

from lfobench.cells.cell import Cell
from lfobench.contract.method import Method
from lfobench.data.firewall import View
from lfobench.engine.checkpoint import Progress
from lfobench.engine.evaluation import Evaluator, final_starts, fixed_starts
from lfobench.engine.evaluation_workers import EvaluationWorkers
from lfobench.engine.logging import log_evaluation, log_final_evaluation
from lfobench.engine.state import MethodState, host
from lfobench.record import Evaluation


class Evaluations:
    """Evaluates a method and logs the results.

    Args:
        cell: what is trained.
        seeds: the seed axis.
        view: the data, for its shapes and its transform of observations.
        device: where the method acts when it is evaluated in this process.
        workers: processes that evaluate beside training; 0 evaluates in this one.
    """

    def __init__(self, cell: Cell, seeds: Sequence[int], view: View, device: torch.device, workers: int) -> None:
        self._cell, self._view, self._seeds, self._device = cell, view, len(seeds), device
        self._evaluator = Evaluator(cell.task, view.transform, len(seeds), fixed_starts(cell), cell.starts)
        self._workers = EvaluationWorkers(cell, view.transform, view.shapes, seeds, workers) if workers else None

    @property
    def in_turn(self) -> bool:
        """True if training waits for every evaluation."""
        return self._workers is None

    def evaluate(self, method: Method, state: MethodState, progress: Progress) -> None:
        """Evaluate the method as it is, and log it now or, from workers, at a later `collect`."""
        if self._workers is not None:
            # One at a time: a queue of snapshots would only hide that evaluation is the bottleneck.
            self.collect(progress, wait=True)
            self._workers.submit(progress.step, state.capture(host()))
            return
        started = time.perf_counter()
        log_evaluation(progress, progress.step, self._evaluator.evaluate(method, self._device))
        progress.seconds["evaluate"] += time.perf_counter() - started

    def collect(self, progress: Progress, wait: bool) -> None:
        """Log the evaluations that workers have finished, or `wait` for all of them."""
        while self._workers is not None and self._workers.pending and (wait or self._workers.ready()):
            evaluated = self._workers.collect()
            progress.seconds["evaluate"] += evaluated.seconds
            log_evaluation(progress, evaluated.step, evaluated.results)

    def final(self, method: Method, progress: Progress) -> list[Evaluation | None]:
        """The final evaluation of the trained policies, per seed; None where there is none, or the seed diverged.

        A policy that answers with something that is not finite has diverged, as in any evaluation.
        """
        cell, starts = self._cell, final_starts(self._cell)
        if not starts:
            return [None] * self._seeds
        started = time.perf_counter()
        evaluator = Evaluator(cell.task, self._view.transform, self._seeds, starts, cell.starts)
        try:
            results = evaluator.evaluate(method, self._device)
        finally:
            evaluator.close()
        progress.seconds["evaluate"] += time.perf_counter() - started
        return log_final_evaluation(progress, cell.protocol.steps_for(cell.task), results)

    def close(self) -> None:
        """Release simulators and worker processes."""
        self._evaluator.close()
        if self._workers is not None:
            self._workers.close()
