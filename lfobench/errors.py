"""Errors that a user can act on: they name the thing, the cause and the way out."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

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


def unknown_name(kind: str, name: str, known: Iterable[str]) -> UserError:
    """The error for a name that nobody registered, with the closest known name as the way out."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    further = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    remedy = f"Did you mean '{close[0]}'?" if close else f"Known: {', '.join(names[:MOST_LISTED]) or 'none'}{further}."
    return UserError(f"Unknown {kind} '{name}'.", remedy)
