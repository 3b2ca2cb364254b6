"""The score of a run: one number out of its learning curve; exact means, and when two scores are level."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from lfobench.errors import UserError

_TAIL = 5
_LONGEST_STEP = 18

_POINTS = 1e-8
"""Sums of a thousand rewards differ by less, in points of 100 from random to expert, by the order of their terms."""

_RELATIVE = 1e-12
"""Of the largest score: numbers of that size are rounded, however close together they lie."""


@dataclass(frozen=True)
class Statistic:
    """Which evaluations count; a run's score is the mean of theirs.

    Attributes:
        name: `last5`: the last five, or all where there are fewer; `last`: the last one; `best`: the one with the
            highest score, the first of several; `at`: the one at `step`; `success`: the last one and the episodes from
            further starts, of which the score is the percentage that succeeded.
        step: gradient step of `at`; None for the others.
    """

    name: Literal["last5", "last", "best", "at", "success"]
    step: int | None = None

    def __str__(self) -> str:
        return self.name if self.step is None else f"{self.name}:{self.step}"

    def choose(self, steps: Sequence[int], scores: Sequence[float]) -> list[int]:
        """Indices of the evaluations that count, given their gradient steps and scores ``[n]``; n is at least 1."""
        everything = list(range(len(steps)))
        if self.name == "last5":
            return everything[-_TAIL:]
        if self.name in ("last", "success"):
            return everything[-1:]
        if self.name == "best":
            return [next(index for index in everything if max(scores) - scores[index] <= tie(scores))]
        return [index for index in everything if steps[index] == self.step]


HEADLINE = Statistic("last5")
"""The statistic of records of scores unless another is asked for."""

SUCCESS_RATE = Statistic("success")
"""That of records which all say how their episodes ended."""


def parse_statistic(text: str) -> Statistic:
    """``last5``, ``last``, ``best``, ``at:STEP`` or ``success``.

    Raises:
        UserError: anything else.
    """
    match text.strip().split(":"):
        case ["last5" | "last" | "best" | "success" as name]:
            return Statistic(name)
        case ["at", step] if step.strip().isdecimal() and len(step) <= _LONGEST_STEP:
            return Statistic("at", int(step))
        case _:
            raise UserError(
                f"Unknown statistic '{text}'.", "Known: last5, last, best, at:STEP (e.g. at:10000), success."
            )


def mean(values: Sequence[float]) -> float:
    """Arithmetic mean of finite numbers ``[n]``, n at least 1, from their exact sum.

    It does not depend on their order, lies between the smallest and the largest, and cannot overflow.
    """
    # A power of two: division by it is exact, and the sum of the shares is no larger than the largest number.
    share = 2.0 ** len(values).bit_length()
    exact = math.fsum(value / share for value in values) / (len(values) / share)
    return min(max(exact, min(values)), max(values))


def tie(*scores: Iterable[float]) -> float:
    """The largest difference between such scores, in points, that is none: rounding alone may have made it.

    Every test, every choice of the best and every verdict asks here, so that none rests on such a difference.
    """
    return max(_POINTS, _RELATIVE * max((abs(score) for each in scores for score in each), default=0.0))
