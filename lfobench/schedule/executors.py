"""Reports of an executor on its jobs."""

from __future__ import annotations

import multiprocessing
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.synchronize import Event as StopFlag
from queue import Empty, SimpleQueue
from typing import Literal

from lfobench.engine.job import Busy, Job, Recorded, TrainedElsewhere
from lfobench.engine.training import Advance
from lfobench.errors import UserError, own_lines
from lfobench.processes import die_with_parent, interrupts_held

Outcome = Literal["done", "stopped", "busy", "failed"]
RunJob = Callable[[Job, Callable[[], bool]], Iterator[Advance | Recorded | TrainedElsewhere]]


@dataclass(frozen=True)
class Ended:
    """A job is over.

    Attributes:
        outcome: how.
        message: one line for the user where there is something to say.
        detail: traceback of a crash, empty otherwise.
        place: the innermost lines of the user's own code in it, see `own_lines`.
    """

    outcome: Outcome
    message: str = ""
    detail: str = ""
    place: tuple[str, ...] = ()


@dataclass(frozen=True)
class Event:
    """Something that happened to the job at `index` of the submitted list."""

    index: int
    what: Advance | Recorded | TrainedElsewhere | Ended


def attempt(
    job: Job, run_job: RunJob, stop: Callable[[], bool]
) -> Iterator[Advance | Recorded | TrainedElsewhere | Ended]:
    """Carry out a job and turn whatever ends it into an `Ended`, so that other jobs go on."""
    try:
        yield from run_job(job, stop)
    except Busy:
        yield Ended("busy", "another process is training it")
    except UserError as error:
        yield Ended("failed", str(error))
    except (Exception, SystemExit) as error:
        yield Ended("failed", f"{type(error).__name__}: {error}", traceback.format_exc(), own_lines(error))
    else:
        yield Ended("stopped" if stop() else "done")


def in_sequence(jobs: Sequence[Job], run_job: RunJob, stop: Callable[[], bool]) -> Iterator[Event]:
    """Carry out `jobs` in order; after a stop the rest is left for the next command."""
    for index, job in enumerate(jobs):
        if stop():
            return
        for what in attempt(job, run_job, stop):
            yield Event(index, what)


POLL_SECONDS = 0.2
MOST_LANES = 16


def in_threads(jobs: Sequence[Job], run_job: RunJob, lanes: int, stop: Callable[[], bool]) -> Iterator[Event]:
    """Carry out `jobs` on `lanes` threads; events of different jobs interleave.

    After a stop the running jobs save their checkpoints and end; the rest is left for the next command.
    """
    events: SimpleQueue[Event | None] = SimpleQueue()
    waiting = deque(enumerate(jobs))
    abandoned = threading.Event()

    def stopped() -> bool:
        return stop() or abandoned.is_set()

    def work(stream: AbstractContextManager[object]) -> None:
        try:
            with stream:
                while not stopped():
                    try:
                        index, job = waiting.popleft()
                    except IndexError:
                        return
                    try:
                        for what in attempt(job, run_job, stopped):
                            events.put(Event(index, what))
                    except BaseException as error:  # an exit: a thread would end without a word
                        message = f"{type(error).__name__}: {error}"
                        events.put(Event(index, Ended("failed", message, traceback.format_exc())))
        finally:
            events.put(None)

    # Daemons, so that a second Ctrl-C ends the process at once.
    # One stream per lane for all its jobs: torch has 32 and hands them out in turn, and two jobs must not share one.
    streams = [_stream(jobs[0].device) for _ in range(min(lanes, len(jobs), MOST_LANES))]
    threads = [threading.Thread(target=work, args=(stream,), daemon=True) for stream in streams]
    for thread in threads:
        thread.start()
    running = len(threads)
    try:
        while running:
            try:
                event = events.get(timeout=POLL_SECONDS)
            except Empty:
                continue  # back in Python, where signals are handled
            if event is None:
                running -= 1
            else:
                yield event
    finally:
        abandoned.set()


def _stream(device: str) -> AbstractContextManager[object]:
    if device != "cuda":
        return nullcontext()
    import torch

    return torch.cuda.stream(torch.cuda.Stream())


LEAVING_SECONDS = 5.0
"""Seconds for a checkpoint that is being written when nobody waits for its job any more."""


class _Worker:
    """One process and the job it is at."""

    def __init__(self, context: SpawnContext, run_job: RunJob, flag: StopFlag) -> None:
        self.pipe, far_end = context.Pipe()
        self.process: SpawnProcess = context.Process(target=_work, args=(far_end, run_job, flag), daemon=True)
        with interrupts_held():
            self.process.start()
        far_end.close()
        self.index: int | None = None

    def give(self, index: int, job: Job) -> bool:
        """True if the process took a job; one that died between two jobs does not."""
        try:
            self.pipe.send(job)
        except OSError:
            return False
        self.index = index
        return True


def in_processes(jobs: Sequence[Job], run_job: RunJob, workers: int, stop: Callable[[], bool]) -> Iterator[Event]:
    """Carry out `jobs` on `workers` processes; events of different jobs interleave.

    After a stop the running jobs save their checkpoints and end; the rest is left for the next command.
    """
    context = multiprocessing.get_context("spawn")
    with interrupts_held():
        flag = context.Event()
    waiting = deque(enumerate(jobs))
    pool = [_Worker(context, run_job, flag) for _ in range(min(workers, len(jobs)))]
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
                    pool[position] = worker = _Worker(context, run_job, flag)
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


def _work(pipe: Connection, run_job: RunJob, flag: StopFlag) -> None:
    die_with_parent()
    while True:
        try:
            job: Job = pipe.recv()
        except (EOFError, OSError):
            return
        except Exception as error:  # a method's or suite's file is no longer what it was
            pipe.send(Ended("failed", f"{type(error).__name__}: {error}", traceback.format_exc()))
            continue
        for what in attempt(job, run_job, flag.is_set):
            try:
                pipe.send(what)
            except OSError:
                return  # nobody listens any more
