"""Evaluation beside training: a pool that evaluates snapshots of a method, each worker the same seeds every time.

The work is split between seeds, never within one: a seed's actions are computed in one ``[K, obs]`` batch however many
workers there are, so their number changes no result.
"""

from __future__ import annotations

import math
import multiprocessing
import pickle
import threading
import time
import traceback
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.util import Finalize
from queue import SimpleQueue
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from lfobench.cells.cell import Cell
from lfobench.contract.method import Shapes
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.evaluation import EpisodeResults, Evaluator, fixed_starts
from lfobench.engine.state import MethodState, SeedState, host
from lfobench.processes import die_with_parent, interrupts_held
from lfobench.registry import load_suite
from lfobench.source_code import check_unchanged

Snapshot = list[SeedState]
"""A method's state as it was, per seed."""


@dataclass(frozen=True)
class Assignment:
    """Seeds that a worker evaluates: ``[first:last]`` of the axis.

    Attributes:
        cell: whose method is evaluated, on its task, with its protocol's episodes.
        transform: from the simulator's observation to the method's.
        shapes: the method's.
        seeds: the whole axis.
        first: of this worker's seeds.
        last: one past them.
    """

    cell: Cell
    transform: ObservationTransform
    shapes: Shapes
    seeds: tuple[int, ...]
    first: int
    last: int

    def part(self, snapshot: Snapshot) -> list[tuple[dict[str, NDArray[Any]], dict[str, Any]]]:
        """The worker's seeds in a snapshot, as arrays: torch would pass tensors through shared memory."""
        share = snapshot[self.first : self.last]
        return [({name: tensor.numpy() for name, tensor in each.tensors.items()}, each.values) for each in share]


@dataclass(frozen=True)
class Part:
    """One evaluation of an assignment's seeds, and how long it took."""

    results: EpisodeResults
    seconds: float


class Failure(Exception):
    """Reason why a worker will not answer; reads as the worker's traceback."""

    def __init__(self, cause: str, detail: str = "") -> None:
        super().__init__(cause, detail)
        self.cause, self.detail = cause, detail

    def __str__(self) -> str:
        return f"\n{self.detail}" if self.detail else self.cause


class Worker:
    """One process.

    Attributes:
        process: to be killed by who closes this.
        pipe: readable when there is a message.
        finished: parts of evaluations that were not collected yet, oldest first.
    """

    def __init__(self, context: SpawnContext, assignment: Assignment) -> None:
        self.finished: deque[Part] = deque()
        self.pipe, far_end = context.Pipe()
        self._assignment = assignment
        # Pickled apart, as multiprocessing would: reading it may need what importing the suite brings.
        arguments = (far_end, assignment.cell.suite, pickle.dumps(assignment))
        self.process: SpawnProcess = context.Process(target=_work, args=arguments, daemon=True)
        with interrupts_held():
            self.process.start()
        far_end.close()
        # A worker that is starting or evaluating does not read, and training must not wait for it.
        self._outbox: SimpleQueue[Any] = SimpleQueue()
        self._sender = threading.Thread(target=_send, args=(self.pipe, self._outbox), daemon=True)
        self._sender.start()

    def send(self, snapshot: Snapshot) -> None:
        """Give it its seeds' share of the state of all seeds, which nobody may change any more; does not wait."""
        self._outbox.put(self._assignment.part(snapshot))

    def receive(self) -> None:
        """Take the next message; raises `Failure` if it is one or the process is gone."""
        try:
            message: Part | Failure = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(timeout=5.0)
            message = Failure(f"its worker process died (exit code {self.process.exitcode})")
        if isinstance(message, Failure):
            raise message
        self.finished.append(message)

    def close(self) -> None:
        """Release what is left of it once its process was killed."""
        self.process.join()
        self._outbox.put(None)
        self._sender.join()
        self.pipe.close()


def _send(pipe: Connection, outbox: SimpleQueue[Any]) -> None:
    # A process that is gone is noticed where its answer is awaited.
    with suppress(OSError):
        while (share := outbox.get()) is not None:
            pipe.send(share)


def _work(pipe: Connection, suite: str, assignment: bytes) -> None:
    die_with_parent()
    torch.set_num_threads(1)
    try:
        load_suite(suite)
        _serve(pipe, pickle.loads(assignment))
    except Exception as error:
        with suppress(OSError):
            pipe.send(Failure(f"{type(error).__name__}: {error}", traceback.format_exc()))


def _serve(pipe: Connection, assignment: Assignment) -> None:
    check_unchanged(assignment.cell.method, assignment.cell.code)
    cell, seeds = assignment.cell, assignment.seeds[assignment.first : assignment.last]
    method = cell.method(cell.config, assignment.shapes, seeds, host())
    state = MethodState.of(method, assignment.shapes, len(seeds))
    evaluator = Evaluator(cell.task, assignment.transform, len(seeds), fixed_starts(cell), cell.starts)
    while True:
        share = pipe.recv()
        started = time.perf_counter()
        state.restore(
            [
                SeedState({name: torch.from_numpy(array) for name, array in arrays.items()}, values)
                for arrays, values in share
            ]
        )
        results = evaluator.evaluate(method, host())
        pipe.send(Part(results, time.perf_counter() - started))


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
        """True if the oldest pending evaluation is finished; False if there is none.

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
    known = [part for part in parts if part is not None]
    return [seed for part in known for seed in part] if len(known) == len(parts) else None


def _end(workers: list[Worker]) -> None:
    for worker in workers:
        worker.process.kill()
    for worker in workers:
        worker.close()
    workers.clear()
