"""Power: seeds that a comparison needs, from a pilot's spread, and the cost of their runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lfobench.errors import UserError
from lfobench.record import Record, usable
from lfobench.score import Statistic
from lfobench.stats.options import Scope
from lfobench.stats.power import Cost, Design, TaskPlan, can_show, cost, plan_tasks, smallest_p
from lfobench.stats.tests import PAIRED, Sample
from lfobench.tables.building import build_table
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.footnote import TESTS
from lfobench.tables.table import Note, competes
from lfobench.text import counted


@dataclass(frozen=True)
class PilotCell:
    """One method on one task.

    Attributes:
        label: of its column.
        sample: its scores.
        seconds: that one more run keeps a worker busy, from the runs of this cell, else from the method's on other
            tasks; None where nobody has measured it.
    """

    label: str
    sample: Sample
    seconds: float | None


@dataclass(frozen=True)
class PilotTask:
    """The two methods of one task with the best means, best first."""

    task: str
    first: PilotCell
    second: PilotCell


@dataclass(frozen=True)
class Pilot:
    """Runs from which a plan is made.

    Attributes:
        tasks: those with two methods.
        without: tasks with fewer.
        devices: where the runs were measured, e.g. ``cpu (AMD EPYC)``.
        parallel: whether any of them was evaluated while it trained.
        notes: of the records' table: what a score is, the source, the protocol.
    """

    tasks: tuple[PilotTask, ...]
    without: tuple[str, ...]
    devices: tuple[str, ...]
    parallel: bool
    notes: tuple[Note, ...]


def read_pilot(
    records: Sequence[Record], statistic: Statistic, scope: Scope = "group", tasks: Sequence[str] = ()
) -> Pilot:
    """The pilot of `records`, whose best two methods in scope are compared on every task.

    Raises:
        UserError: there are no records, they must not share a table, or no task has two methods in scope.
    """
    table = build_table(records, statistic, tasks=tasks)
    columns = arrange_columns(records)
    found, without = [], []
    for _, row in table.rows():
        cells = {
            column: cell.sample
            for column, cell in zip(table.columns, row.cells, strict=True)
            if cell is not None and cell.sample is not None and column in columns and competes(column, scope)
        }
        best = sorted(cells, key=lambda column: -cells[column].summary.mean)[:2]
        if len(best) < 2:
            without.append(row.task)
            continue
        pair = [PilotCell(each.label, cells[each], _seconds(columns[each], row.task)) for each in best]
        found.append(PilotTask(row.task, *pair))
    if not found:
        among = " without access to expert actions" if scope == "group" else ""
        raise UserError(
            f"No task of these records has two methods{among}.",
            "Run a second method; --scope all takes all methods, --methods those that you name.",
        )
    return Pilot(
        tuple(found),
        tuple(without),
        tuple(sorted({_device(record) for record in records})),
        any(_evaluated_in_parallel(record) for record in records),
        tuple(note for note in table.notes if note.label in ("Score", "Source", "Protocol")),
    )


def run_seconds(record: Record) -> float | None:
    """Seconds that the record's run kept a worker busy: loading, then training and evaluation.

    Both add up where they take turns, as on a CPU. On CUDA other processes evaluate during training, so the longer of
    the two counts. The time of seeds that trained together is shared equally among them. None where it is not known.
    """
    seconds = _mapping(record.provenance.get("seconds"))
    train = _number(seconds.get("train"))
    if train is None:
        return None
    evaluate, load = (_number(seconds.get(kind)) or 0.0 for kind in ("evaluate", "load"))
    spent = max(train, evaluate) if _evaluated_in_parallel(record) else train + evaluate
    return (spent + load) / max(1.0, _number(record.provenance.get("seeds_trained_together")) or 1.0)


def _seconds(records: Sequence[Record], task: str) -> float | None:
    here = list(_measured(record for record in records if record.task == task))
    measured = here or list(_measured(iter(records)))
    return sum(measured) / len(measured) if measured else None


def _measured(records: Iterator[Record]) -> Iterator[float]:
    return (seconds for record in records if (seconds := run_seconds(record)) is not None)


def _evaluated_in_parallel(record: Record) -> bool:
    return _mapping(record.provenance.get("device")).get("type") == "cuda"


def _device(record: Record) -> str:
    device = _mapping(record.provenance.get("device"))
    name = f" ({device['name']})" if device.get("name") else ""
    return f"{device.get('type', 'an unknown device')}{name}"


def _mapping(value: Any) -> Mapping[str, Any]:
    # Provenance is free text of whoever wrote the record.
    return value if isinstance(value, Mapping) else {}


def _number(value: Any) -> float | None:
    return float(value) if usable(value) and value >= 0 else None


Target = Callable[[TaskPlan], int | None]


@dataclass(frozen=True)
class Budget:
    """The cost of reaching a number of seeds on every task.

    Attributes:
        name: of the number of seeds, e.g. ``5 seeds everywhere``.
        cost: of the runs that are missing.
        without: tasks for which no number is known.
    """

    name: str
    cost: Cost
    without: tuple[str, ...]


@dataclass(frozen=True)
class SeedPlan:
    """A plan for a pilot; `tasks` are in the pilot's order."""

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
        """The reason why the planned seeds cannot show anything with the chosen test; None where they can."""
        design, starts = self.design, self.starts
        if can_show(design, len(self.tasks), starts):
            return None
        n, unit = (design.seeds, "seed") if starts is None else (starts, "start state")
        smallest = smallest_p(design.test, n, n)
        if smallest is None:
            return f"{n} {unit} per method cannot be tested"
        times = f", times {len(self.tasks)} under Holm" if design.correction == "holm" and len(self.tasks) > 1 else ""
        return f"with {n} {unit}s, {TESTS[design.test]} gives at best p = {smallest:.2g}{times}"


def seeds_needed(pilot: Pilot, design: Design, workers: int = 1) -> SeedPlan:
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
        (f"{counted(design.seeds, 'seed')} everywhere", lambda _: design.seeds),
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
