"""Evaluation beside training: a pool that evaluates snapshots of a method, each worker the same seeds every time.

The work is split between seeds, never within one: a seed's actions are computed in one ``[K, obs]`` batch however many
workers there are, so their number changes no result.
"""

from __future__ import annotations

import math
import multiprocessing
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing.connection import wait
from multiprocessing.util import Finalize

import numpy as np

from lfobench.contract.method import Shapes
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.evaluation_process import Assignment, Failure, Snapshot, Worker
from lfobench.engine.rollout import EpisodeResults
from lfobench.plan.cells import Cell


class EvaluationError(Exception):
    """A worker raised or died; its own traceback, where there is one, is the cause of this exception."""


@dataclass(frozen=True)
class Evaluated:
    """A finished evaluation.

    Attributes:
        step: as submitted.
        results: of all seeds.
        seconds: that the slowest worker was at it.
    """

    step: int
    results: EpisodeResults
    seconds: float


class EvaluationWorkers:
    """A pool that evaluates one cell; processes start with the first submission and keep their simulators.

    Args:
        cell: whose method is evaluated, on its task, with its protocol's episodes.
        transform: from the simulator's observation to the method's.
        shapes: the method's.
        seeds: the seed axis.
        workers: processes at most; no more than there are seeds.

    Raises:
        ValueError: for less than one worker or seed.
    """

    def __init__(
        self, cell: Cell, transform: ObservationTransform, shapes: Shapes, seeds: Sequence[int], workers: int
    ) -> None:
        count = min(workers, len(seeds))
        if count < 1:
            raise ValueError(f"{workers} workers cannot evaluate {len(seeds)} seeds")
        self._cell = cell
        bounds = pairwise(len(seeds) * index // count for index in range(count + 1))
        self._assignments = [Assignment(cell, transform, shapes, tuple(seeds), *part) for part in bounds]
        self._workers: list[Worker] = []
        self._submitted: deque[int] = deque()
        # An interpreter that exits waits for its child processes before it forgets this object.
        self._end = Finalize(self, _end, args=(self._workers,), exitpriority=1)

    @property
    def pending(self) -> int:
        """Evaluations submitted and not collected."""
        return len(self._submitted)

    def submit(self, step: int, snapshot: Snapshot) -> None:
        """Evaluate a state that nobody changes any more; waits for nothing.

        Args:
            step: names the evaluation.
            snapshot: the method's state per seed, on the CPU.
        """
        if not self._workers:
            context = multiprocessing.get_context("spawn")
            for assignment in self._assignments:
                self._workers.append(Worker(context, assignment))
        self._submitted.append(step)
        for worker in self._workers:
            worker.send(snapshot)

    def ready(self, timeout: float | None = 0.0) -> bool:
        """Whether the oldest pending evaluation is finished; False if there is none.

        Args:
            timeout: seconds to wait for it at most; None waits as long as it takes.

        Raises:
            EvaluationError: when a worker failed at it; all workers are then gone, and what was pending with them.
        """
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        while self._submitted:
            late = {worker.pipe: worker for worker in self._workers if not worker.finished}
            if not late:
                return True
            left = None if deadline == math.inf else max(0.0, deadline - time.monotonic())
            found = wait(list(late), left)
            if not found:
                return False
            for pipe in found:
                self._receive(late[pipe])  # type: ignore[index]
        return False

    def collect(self) -> Evaluated:
        """The oldest pending evaluation; waits until it is finished.

        Raises:
            EvaluationError: as `ready`.
            ValueError: when none is pending.
        """
        if not self._submitted:
            raise ValueError("no evaluation is pending")
        self.ready(timeout=None)
        parts = [worker.finished.popleft() for worker in self._workers]
        results = EpisodeResults(
            returns=np.concatenate([part.results.returns for part in parts]),
            lengths=np.concatenate([part.results.lengths for part in parts]),
            finite=np.concatenate([part.results.finite for part in parts]),
            outcomes=_joined([part.results.outcomes for part in parts]),
        )
        return Evaluated(self._submitted.popleft(), results, max(part.seconds for part in parts))

    def close(self) -> None:
        """End the workers at once; what is pending is lost. A later submission starts new ones."""
        self._submitted.clear()
        _end(self._workers)

    def _receive(self, worker: Worker) -> None:
        step = self._submitted[0]
        try:
            worker.receive()
        except Failure as failure:
            self.close()
            message = f"the evaluation of {self._cell.label} at step {step} failed: {failure.cause}"
            raise EvaluationError(message) from failure


def _joined(parts: Sequence[list[list[str]] | None]) -> list[list[str]] | None:
    told = [part for part in parts if part is not None]
    return [seed for part in told for seed in part] if len(told) == len(parts) else None


def _end(workers: list[Worker]) -> None:
    for worker in workers:
        worker.process.kill()
    for worker in workers:
        worker.close()
    workers.clear()
