"""The tiny suite with grids: of two methods on one of its tasks, of one method on the other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lfobench.contract.suite import Task
from lfobench.registry import load_suite

TINY = load_suite(str(Path(__file__).with_name("tiny_suite.py")))

GRIDS = {
    "pole-random-expert": {
        "bc": {"learning_rate": (0.01, 1)},
        "bco": {"inverse_dynamics_epochs": (2, 1)},
    },
    "pole-medium-expert": {"bc": {"learning_rate": (0.01, 0.02), "hidden": ((8, 8), (16, 16), (4,))}},
}
SETTINGS = {"bc": {"batch_size": 24, "learning_rate": 0.5}}


def _with_grid(task: Task) -> Task:
    return replace(task, grids=GRIDS[task.name], settings=SETTINGS)


SUITE = replace(TINY, name="tuned", summary="a pole with grids, for tests", tasks=tuple(map(_with_grid, TINY.tasks)))
