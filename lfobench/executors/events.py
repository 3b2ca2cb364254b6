"""What an executor reports of its jobs."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from lfobench.engine.job import Busy, Job, Left, Recorded
from lfobench.engine.training import Advance
from lfobench.errors import UserError, own_lines

Outcome = Literal["done", "stopped", "busy", "failed"]
CarryOut = Callable[[Job, Callable[[], bool]], Iterator[Advance | Recorded | Left]]


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
    what: Advance | Recorded | Left | Ended


def attempt(job: Job, carry_out: CarryOut, stop: Callable[[], bool]) -> Iterator[Advance | Recorded | Left | Ended]:
    """Carry out a job and turn whatever ends it into an `Ended`, so that other jobs go on."""
    try:
        yield from carry_out(job, stop)
    except Busy:
        yield Ended("busy", "another process is training it")
    except UserError as error:
        yield Ended("failed", str(error))
    except (Exception, SystemExit) as error:
        yield Ended("failed", f"{type(error).__name__}: {error}", traceback.format_exc(), own_lines(error))
    else:
        yield Ended("stopped" if stop() else "done")
