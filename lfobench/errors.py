"""Errors that a user can act on: they name the thing, the cause and the way out."""

from __future__ import annotations

import difflib
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


def cause(error: BaseException) -> str:
    """An error of somebody else's code in words, with the line of their file: ``NameError: … (mine.py, line 7)``."""
    ours = Path(__file__).resolve().parent
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<frozen") and not Path(frame.filename).is_relative_to(ours)
    ]
    known = isinstance(error, SyntaxError) or not frames
    where = "" if known else f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})"
    return f"{type(error).__name__}: {error}{where}"


def unknown_name(kind: str, name: str, known: Iterable[str]) -> UserError:
    """The error for a name that nobody registered, with the closest known name as the way out."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    further = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    remedy = f"Did you mean '{close[0]}'?" if close else f"Known: {', '.join(names[:MOST_LISTED]) or 'none'}{further}."
    return UserError(f"Unknown {kind} '{name}'.", remedy)
