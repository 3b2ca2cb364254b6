"""Jobs on a pool of worker processes.

Each worker has a pipe. A worker that dies (out of memory, a crash in the simulator) fails its own job and is
replaced; a parent that dies takes its workers along, so that nothing trains unseen.
"""

from __future__ import annotations

import multiprocessing
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.synchronize import Event as StopFlag

from lfobench.engine.job import Job
from lfobench.executors.events import CarryOut, Ended, Event, attempt
from lfobench.processes import die_with_parent, interrupts_held

POLL_SECONDS = 0.2
LEAVING_SECONDS = 5.0
"""For a checkpoint that is being written when nobody waits for its job any more."""


class _Worker:
    """One process and the job it is at."""

    def __init__(self, context: SpawnContext, carry_out: CarryOut, flag: StopFlag) -> None:
        self.pipe, far_end = context.Pipe()
        self.process: SpawnProcess = context.Process(target=_work, args=(far_end, carry_out, flag), daemon=True)
        with interrupts_held():
            self.process.start()
        far_end.close()
        self.index: int | None = None

    def give(self, index: int, job: Job) -> bool:
        """Whether the process took a job; one that died between two jobs does not."""
        try:
            self.pipe.send(job)
        except OSError:
            return False
        self.index = index
        return True


def in_processes(jobs: Sequence[Job], carry_out: CarryOut, workers: int, stop: Callable[[], bool]) -> Iterator[Event]:
    """Carry out `jobs` on `workers` processes; events of different jobs interleave.

    After a stop the running jobs save their checkpoints and end; the rest is left for the next command.
    """
    context = multiprocessing.get_context("spawn")
    with interrupts_held():
        flag = context.Event()
    waiting = deque(enumerate(jobs))
    pool = [_Worker(context, carry_out, flag) for _ in range(min(workers, len(jobs)))]
    try:
        while True:
            if stop():
                flag.set()
                waiting.clear()
            for position, worker in enumerate(pool):
                if worker.index is None and waiting:
                    index, job = waiting.popleft()
                    if worker.process.is_alive() and worker.give(index, job):
                        continue
                    _end([worker])
                    pool[position] = worker = _Worker(context, carry_out, flag)
                    if not worker.give(index, job):
                        yield Event(index, _died(worker))
            busy = {worker.pipe: worker for worker in pool if worker.index is not None}
            if not (busy or waiting):
                return
            for ready in wait(list(busy), timeout=POLL_SECONDS):
                yield from _receive(busy[ready])  # type: ignore[index]
    finally:
        flag.set()
        _end(pool)


def _end(pool: Sequence[_Worker]) -> None:
    """Let the processes leave, and kill those that take too long; none of them is left, not even as a zombie."""
    patience = time.monotonic() + LEAVING_SECONDS
    try:
        for worker in pool:
            worker.pipe.close()
        for worker in pool:
            worker.process.join(timeout=max(0.0, patience - time.monotonic()))
    finally:
        for worker in pool:
            worker.process.kill()
            worker.process.join()


def _receive(worker: _Worker) -> Iterator[Event]:
    index = worker.index
    assert index is not None
    try:
        what = worker.pipe.recv()
    except (EOFError, OSError):
        what = _died(worker)
    if isinstance(what, Ended):
        worker.index = None
    yield Event(index, what)


def _died(worker: _Worker) -> Ended:
    worker.process.join(timeout=LEAVING_SECONDS)
    return Ended("failed", f"its worker process died (exit code {worker.process.exitcode})")


def _work(pipe: Connection, carry_out: CarryOut, flag: StopFlag) -> None:
    die_with_parent()
    while True:
        try:
            job: Job = pipe.recv()
        except (EOFError, OSError):
            return
        except Exception as error:  # a method's or suite's file is no longer what it was
            pipe.send(Ended("failed", f"{type(error).__name__}: {error}", traceback.format_exc()))
            continue
        for what in attempt(job, carry_out, flag.is_set):
            try:
                pipe.send(what)
            except OSError:
                return  # nobody listens any more
