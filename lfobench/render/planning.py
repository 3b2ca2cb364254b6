"""A plan of seeds as every exporter draws it: the pilot, what it asks for, what that costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from lfobench.errors import UserError
from lfobench.render.highlight_note import TESTS
from lfobench.render.pilot import Pilot
from lfobench.stats.comparison import PAIRED
from lfobench.stats.feasibility import smallest_p
from lfobench.stats.planning import Cost, Design, TaskPlan, can_show, cost, plan_tasks

Target = Callable[[TaskPlan], int | None]


@dataclass(frozen=True)
class Budget:
    """What it takes to reach a number of seeds on every task.

    Attributes:
        name: which number, in words.
        cost: of the runs that are missing.
        without: tasks for which no number is known.
    """

    name: str
    cost: Cost
    without: tuple[str, ...]


@dataclass(frozen=True)
class SeedPlan:
    """A pilot and what follows from it; `tasks` are in the pilot's order."""

    pilot: Pilot
    design: Design
    tasks: tuple[TaskPlan, ...]
    workers: int
    budgets: tuple[Budget, ...]

    @property
    def corrected_alpha(self) -> float:
        """Level of the correction's first step."""
        return self.design.first_step(len(self.tasks))

    @property
    def starts(self) -> int | None:
        """Pairs of a test that pairs start states, on the task that has the fewest; None for a test over seeds."""
        if self.design.test not in PAIRED:
            return None
        return min(len(cell.sample.starts) for task in self.pilot.tasks for cell in (task.first, task.second))

    @property
    def blind_because(self) -> str | None:
        """Why the planned seeds cannot show anything with the chosen test; None where they can."""
        design, starts = self.design, self.starts
        if can_show(design, len(self.tasks), starts):
            return None
        n, unit = (design.seeds, "seed") if starts is None else (starts, "start state")
        smallest = smallest_p(design.test, n, n)
        if smallest is None:
            return f"{n} {unit} per method cannot be tested"
        times = f", times {len(self.tasks)} under Holm" if design.correction == "holm" and len(self.tasks) > 1 else ""
        return f"with {n} {unit}s, {TESTS[design.test]} gives at best p = {smallest:.2g}{times}"


def plan_seeds(pilot: Pilot, design: Design, workers: int = 1) -> SeedPlan:
    """The plan for a pilot.

    Raises:
        UserError: a test of counts, the effect is not positive, or a power or level is not strictly between 0 and 1.
    """
    if design.test == "fisher":
        raise UserError("'fisher' counts episodes, and a plan counts seeds.", "Leave --test out: welch takes seeds.")
    if not 0.0 < design.effect < math.inf:
        raise UserError(f"An effect of {design.effect:g} points cannot be planned for.", "Write, e.g., --effect 10.")
    for name, value, example in (("power", design.power, "0.8"), ("alpha", design.alpha, "0.05")):
        if not 0.0 < value < 1.0:
            raise UserError(f"--{name} {value:g} is not strictly between 0 and 1.", f"Write, e.g., --{name} {example}.")
    pairs = [(task.first.sample.summary, task.second.sample.summary) for task in pilot.tasks]
    tasks = plan_tasks(pairs, design)
    targets: tuple[tuple[str, Target], ...] = (
        (f"{_counted(design.seeds)} everywhere", lambda _: design.seeds),
        ("the seeds needed by the pilot's spread", lambda task: task.pilot.seeds_corrected if task.pilot else None),
        ("the seeds needed by its upper bound", lambda task: task.cautious.seeds_corrected if task.cautious else None),
    )
    return SeedPlan(
        pilot,
        design,
        tuple(tasks),
        workers,
        tuple(_budget(name, target, pilot, tasks, workers) for name, target in targets),
    )


def _counted(seeds: int) -> str:
    return f"{seeds} seed{'' if seeds == 1 else 's'}"


def _budget(name: str, target: Target, pilot: Pilot, plans: Sequence[TaskPlan], workers: int) -> Budget:
    missing: list[tuple[int, float | None]] = []
    without = []
    for task, plan in zip(pilot.tasks, plans, strict=True):
        wanted = target(plan)
        if wanted is None:
            without.append(task.task)
            continue
        missing += [(max(0, wanted - cell.sample.summary.n), cell.seconds) for cell in (task.first, task.second)]
    return Budget(name, cost(missing, workers), tuple(without))
