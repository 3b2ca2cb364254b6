"""Errors that a user can act on: they name the thing, the cause and the way out."""

from __future__ import annotations

import difflib
import sysconfig
import traceback
from collections.abc import Iterable
from pathlib import Path

MOST_LISTED = 30
"""Known names in one message."""


class UserError(Exception):
    """A mistake outside the program; the command line prints it on one line and exits with code 2.

    Args:
        problem: what is wrong, naming the thing and the cause.
        remedy: what to type or do next.
    """

    def __init__(self, problem: str, remedy: str = "") -> None:
        super().__init__(f"{problem} {remedy}".strip())
        self.problem = problem
        self.remedy = remedy


MOST_OWN_LINES = 3
"""Of a traceback, in a message; the innermost ones."""

_HARNESS = str(Path(__file__).resolve().parent)
_LIBRARIES = tuple({path for name in ("purelib", "platlib", "stdlib") if (path := sysconfig.get_path(name))})


def cause(error: BaseException) -> str:
    """An error of somebody else's code in words, with the line of their file: ``NameError: … (mine.py, line 7)``."""
    frames = _frames(error)
    innermost = [*frames, *_own(frames)][-1:]
    known = isinstance(error, SyntaxError) or not innermost
    where = "" if known else f" ({Path(innermost[0].filename).name}, line {innermost[0].lineno})"
    return f"{type(error).__name__}: {error}{where}"


def own_lines(error: BaseException) -> tuple[str, ...]:
    """Where an exception passed through code that is neither the harness nor an installed library, innermost last.

    ``mine.py:12, in update: loss = self.loss(batch)``; empty where it passed through none.
    """
    return tuple(
        f"{frame.filename}:{frame.lineno}, in {frame.name}{f': {frame.line}' if frame.line else ''}"
        for frame in _own(_frames(error))[-MOST_OWN_LINES:]
    )


def _frames(error: BaseException) -> list[traceback.FrameSummary]:
    """The frames outside the harness."""
    frames = traceback.extract_tb(error.__traceback__)
    return [frame for frame in frames if not frame.filename.startswith(("<frozen", _HARNESS))]


def _own(frames: list[traceback.FrameSummary]) -> list[traceback.FrameSummary]:
    return [frame for frame in frames if not frame.filename.startswith(("<", *_LIBRARIES))]


def unknown_name(kind: str, name: str, known: Iterable[str]) -> UserError:
    """The error for a name that nobody registered, with the closest known name as the way out."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    further = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    remedy = f"Did you mean '{close[0]}'?" if close else f"Known: {', '.join(names[:MOST_LISTED]) or 'none'}{further}."
    return UserError(f"Unknown {kind} '{name}'.", remedy)
