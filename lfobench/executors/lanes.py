"""Jobs side by side on one device: threads of this process, each with a stream of its own.

While one job loads its data, records its steps or waits for its evaluations, the others keep the device busy.
"""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from queue import Empty, SimpleQueue


from lfobench.engine.job import Job
from lfobench.executors.events import CarryOut, Ended, Event, attempt

POLL_SECONDS = 0.2
MOST_LANES = 16


def in_threads(jobs: Sequence[Job], carry_out: CarryOut, lanes: int, stop: Callable[[], bool]) -> Iterator[Event]:
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
                        for what in attempt(job, carry_out, stopped):
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
