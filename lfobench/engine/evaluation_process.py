"""One process that evaluates snapshots of a method for some of its seeds, and the parent's handle of it."""

from __future__ import annotations

import pickle
import threading
import time
import traceback
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from queue import SimpleQueue
from typing import Any

import torch
from numpy.typing import NDArray

from lfobench.contract.method import Shapes
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.evaluation import Evaluator, fixed_starts
from lfobench.engine.rollout import EpisodeResults
from lfobench.engine.state import CPU, MethodState, SeedState
from lfobench.plan.cells import Cell
from lfobench.processes import die_with_parent, interrupts_held
from lfobench.registry import load_suite
from lfobench.source_code import check_unchanged

Snapshot = list[SeedState]
"""A method's state as it was, per seed."""


@dataclass(frozen=True)
class Assignment:
    """What a worker evaluates: the seeds ``[first:last]`` of the axis.

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
        """Its seeds' share of a snapshot, as arrays: torch would pass tensors through shared memory."""
        share = snapshot[self.first : self.last]
        return [({name: tensor.numpy() for name, tensor in each.tensors.items()}, each.values) for each in share]


@dataclass(frozen=True)
class Part:
    """One evaluation of an assignment's seeds, and how long it took."""

    results: EpisodeResults
    seconds: float


class Failure(Exception):
    """Why a worker will not answer; reads as the worker's traceback."""

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
    method = cell.method(cell.config, assignment.shapes, seeds, CPU)
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
        results = evaluator.evaluate(method, CPU)
        pipe.send(Part(results, time.perf_counter() - started))
