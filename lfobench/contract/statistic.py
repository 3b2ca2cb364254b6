"""What a run's evaluations are reduced to: one number out of a learning curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from lfobench.errors import UserError

_TAIL = 5
_LONGEST_STEP = 18


@dataclass(frozen=True)
class Statistic:
    """Which evaluations count; a run's score is the mean of theirs.

    Attributes:
        name: `last5`: the last five, or all where there are fewer; `last`: the last one; `best`: the one with the
            highest score; `at`: the one at `step`.
        step: gradient step of `at`; None for the others.
    """

    name: Literal["last5", "last", "best", "at"]
    step: int | None = None

    def __str__(self) -> str:
        return self.name if self.step is None else f"{self.name}:{self.step}"

    def choose(self, steps: Sequence[int], scores: Sequence[float]) -> list[int]:
        """Indices of the evaluations that count, given their gradient steps and scores ``[n]``; n is at least 1."""
        everything = list(range(len(steps)))
        if self.name == "last5":
            return everything[-_TAIL:]
        if self.name == "last":
            return everything[-1:]
        if self.name == "best":
            return [max(everything, key=lambda index: scores[index])]
        return [index for index in everything if steps[index] == self.step]


HEADLINE = Statistic("last5")
"""The statistic of a table unless another is asked for."""


def parse_statistic(text: str) -> Statistic:
    """``last5``, ``last``, ``best`` or ``at:STEP``.

    Raises:
        UserError: anything else.
    """
    match text.strip().split(":"):
        case ["last5" | "last" | "best" as name]:
            return Statistic(name)
        case ["at", step] if step.strip().isdecimal() and len(step) <= _LONGEST_STEP:
            return Statistic("at", int(step))
        case _:
            raise UserError(f"Unknown statistic '{text}'.", "Known: last5, last, best, at:STEP, e.g. at:10000.")
