"""What a picture of an episode needs to know of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.record import SUCCESS
from lfobench.render.plots.compared import run_cells
from lfobench.render.plots.style import Look, look
from lfobench.render.table import Table

Points = NDArray[np.floating[Any]]
"""Positions ``[T, 2]`` in metres."""


class Seen(Protocol):
    """An episode of T steps from above: positions ``[T + 1, 2]`` in metres."""

    @property
    def start(self) -> int:
        """Number of the fixed start."""
        ...

    @property
    def step_seconds(self) -> float:
        """How long a step takes."""
        ...

    @property
    def effector(self) -> Points:
        """Of the end-effector."""
        ...

    @property
    def puck(self) -> Points | None:
        """Of the puck, where there is one."""
        ...

    @property
    def outcome(self) -> str:
        """How it ended, in the environment's words."""
        ...


# Vermilion first, the other blue late; these seven differ in grey from each other and from a success.
_FAILURES = (4, 1, 3, 5, 2, 6, 14)
_ROUND = 16


def outcome_looks(outcomes: Iterable[str]) -> dict[str, Look]:
    """One look per outcome: success first, then the failures by name."""
    failures = sorted(set(outcomes) - {SUCCESS})
    slots = [_ROUND * (index // len(_FAILURES)) + _FAILURES[index % len(_FAILURES)] for index in range(len(failures))]
    return {SUCCESS: look(0)} | {name: look(slot) for name, slot in zip(failures, slots, strict=True)}


def whose(table: Table) -> str:
    """Whose policies a picture shows, for its caption."""
    seeds = sorted({seed for _, row in table.rows() for cell in run_cells(table, row).values() for seed in cell.seeds})
    return f"Policies at the end of training, seed {', '.join(map(str, seeds))}."
