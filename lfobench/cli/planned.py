"""What a command will do: the plan held against the records and the dataset cache."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from lfobench.cli.console import duration, output
from lfobench.contract.record import Record
from lfobench.contract.suite import Task
from lfobench.data.build import ShardJob, missing_shards
from lfobench.data.cache import PartCache
from lfobench.engine.probe import Prober
from lfobench.plan.cells import Cell, Run
from lfobench.plan.names import select_tasks, split_names
from lfobench.plan.parts import SHARD_TRANSITIONS, PartRequest, requests
from lfobench.plan.planning import Plan, choose_protocol
from lfobench.registry import load_suite


@dataclass(frozen=True)
class Agenda:
    """A plan and what is left of it.

    Attributes:
        plan: everything asked for.
        done: runs whose record is there.
        pending: runs still to do.
        requests: the generated parts that they read, by task.
        shards: what of those is still to build.
        cache: root of the dataset cache.
        workers: processes to use.
    """

    plan: Plan
    done: Sequence[Run]
    pending: Sequence[Run]
    requests: Sequence[tuple[str, PartRequest]]
    shards: Sequence[ShardJob]
    cache: Path
    workers: int

    def pending_seeds(self, cell: Cell) -> tuple[int, ...]:
        """Seeds of one cell still to do."""
        return tuple(run.seed for run in self.pending if run.cell is cell)


def agenda(plan: Plan, records: Sequence[Record], cache: Path, workers: int) -> Agenda:
    """Hold a plan against the records and the dataset cache; writes nothing."""
    there = {record.identity_hash for record in records}
    done: list[Run] = []
    pending: list[Run] = []
    for run in plan.runs:
        (done if run.identity_hash in there else pending).append(run)
    cells = {run.cell.task.name: run.cell for run in pending}
    wanted = [
        (name, request) for name, cell in cells.items() for request in requests(plan.suite, cell.task, cell.recipe)
    ]
    suite = plan.cells[0].suite
    return Agenda(plan, done, pending, wanted, missing_shards(cache, suite, wanted), cache, workers)


@dataclass(frozen=True)
class Forecast:
    """How long an agenda will take on this machine.

    Attributes:
        run_seconds: per pending run, were it alone on a core or device.
        total_seconds: data and runs, spread over the workers.
    """

    run_seconds: Sequence[float]
    total_seconds: float


def forecast(agenda: Agenda, prober: Prober) -> Forecast:
    """Estimate every pending run from the probe."""
    cells = {id(run.cell): run.cell for run in agenda.pending}
    seconds = {key: prober.estimate(cell).total for key, cell in cells.items()}
    run_seconds = [seconds[id(run.cell)] for run in agenda.pending]
    spread = sum(run_seconds) / agenda.workers
    data = _building_seconds(agenda, prober) / min(agenda.workers, len(agenda.shards) or 1)
    return Forecast(run_seconds, data + max([spread, *run_seconds]))


def _building_seconds(agenda: Agenda, prober: Prober) -> float:
    """Of making the missing shards one after another."""
    suite, tasks = agenda.plan.suite, {task.name: task for task in agenda.plan.tasks}
    seconds = 0.0
    for (task, level), shards in Counter((job.task, job.level) for job in agenda.shards).items():
        environment = tasks[task].environment
        demonstrator = suite.demonstrator(environment.name, level)
        seconds += shards * SHARD_TRANSITIONS * prober.generation(environment, demonstrator)
    return seconds


def show(agenda: Agenda, expected: Forecast, out: Path) -> None:
    """Print the plan: a row per task, a column per method, what is done of each cell."""
    plan = agenda.plan
    methods = list(dict.fromkeys(cell.method.name for cell in plan.cells))
    finished = {(run.cell.method.name, run.cell.task.name, run.seed) for run in agenda.done}
    table = Table(
        "task", *(escape(name) for name in methods), title="Plan: runs done of runs wanted", title_style="bold"
    )
    for task in plan.tasks:
        counts = [sum((name, task.name, seed) in finished for seed in plan.seeds) for name in methods]
        table.add_row(escape(task.name), *(f"{count}/{len(plan.seeds)}" for count in counts))
    output.print(table)
    protocol = plan.protocol
    reason = f" ({plan.protocol_reason})" if plan.protocol_reason else ""
    output.print(f"protocol  {protocol.name}{reason}: {protocol.summary}")
    if protocol.assigned_steps is not None:
        output.print(f"steps     {protocol.assigned_steps:,}, set with --steps")
    output.print(f"device    {plan.device}, {agenda.workers} worker{'s' if agenda.workers > 1 else ''}")
    output.print(f"records   {escape(str(out))}", soft_wrap=True)
    if agenda.shards:
        output.print(f"data      {len(agenda.shards)} shards to build into {escape(str(agenda.cache))}", soft_wrap=True)
    if agenda.pending:
        output.print(
            f"to do     {len(agenda.pending)} of {len(plan.runs)} runs, about {duration(expected.total_seconds)}"
        )
    else:
        output.print(f"to do     nothing: all {len(plan.runs)} runs are done")


def as_json(agenda: Agenda, expected: Forecast) -> dict[str, Any]:
    """The plan for scripts."""
    return {
        "suite": agenda.plan.suite.name,
        "protocol": agenda.plan.protocol.name,
        "protocol_reason": agenda.plan.protocol_reason,
        "assigned_steps": agenda.plan.protocol.assigned_steps,
        "device": agenda.plan.device,
        "workers": agenda.workers,
        "shards_to_build": len(agenda.shards),
        "estimated_seconds": round(expected.total_seconds, 1),
        "runs": [
            {
                "method": run.cell.method.name,
                "task": run.cell.task.name,
                "seed": run.seed,
                "identity": run.identity_hash,
                "done": done,
            }
            for runs, done in ((agenda.done, True), (agenda.pending, False))
            for run in runs
        ],
    }


def shards_of_suite(suite: str, tasks: str | None, protocol: str, root: Path) -> list[ShardJob]:
    """The shards that the chosen tasks of a suite lack under a protocol."""
    return missing_shards(root, suite, _requests_of_suite(suite, tasks, protocol))


def cached_fingerprints(plan: Plan, task: Task, root: Path) -> dict[str, str]:
    """Fingerprints of a task's parts as the cache holds them; a part that is not whole is left out."""
    parts = zip(("offline", "expert"), requests(plan.suite, task, plan.protocol.recipe_for(task)), strict=True)
    marks = {
        part: PartCache(root, request.specification).declared_fingerprint(request.transitions)
        for part, request in parts
    }
    return {part: mark for part, mark in marks.items() if mark is not None}


def data_status(suite: str, tasks: str | None, protocol: str, root: Path) -> list[dict[str, Any]]:
    """Per task and part: transitions needed, shards there, folder."""
    rows = []
    for task, request in _requests_of_suite(suite, tasks, protocol):
        cache = PartCache(root, request.specification)
        shards = request.specification.shards_for(request.transitions)
        rows.append(
            {
                "task": task,
                "part": request.specification.level,
                "transitions": request.transitions,
                "shards": shards,
                "shards_present": shards - len(cache.missing(request.transitions)),
                "folder": str(cache.folder),
            }
        )
    return rows


def _requests_of_suite(suite: str, tasks: str | None, protocol: str) -> list[tuple[str, PartRequest]]:
    import torch

    loaded = load_suite(suite)
    budget = choose_protocol(protocol, "cuda" if torch.cuda.is_available() else "cpu")[0]
    chosen = select_tasks(loaded.tasks, ["*"] if tasks is None else split_names(tasks))
    return [(task.name, request) for task in chosen for request in requests(loaded, task, budget.recipe_for(task))]


def plain(value: Any) -> Any:
    """A dataclass as plain JSON data; None stays None."""
    return None if value is None else asdict(value)
