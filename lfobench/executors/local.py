"""Jobs one after another in this process: the reference, and the executor of a single device."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from lfobench.engine.job import Job
from lfobench.executors.events import CarryOut, Event, attempt


def in_sequence(jobs: Sequence[Job], carry_out: CarryOut, stop: Callable[[], bool]) -> Iterator[Event]:
    """Carry out `jobs` in order; after a stop the rest is left for the next command."""
    for index, job in enumerate(jobs):
        if stop():
            return
        for what in attempt(job, carry_out, stop):
            yield Event(index, what)
