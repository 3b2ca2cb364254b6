"""Plan of a command, shown before it is carried out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from lfobench.cells.cell import Protocol
from lfobench.cells.sources import absent_files
from lfobench.cli.console import duration, output
from lfobench.cli.options import warn
from lfobench.contract.environment import ActionBox
from lfobench.contract.suite import Task
from lfobench.schedule.jobs import Forecast, Needs, Schedule
from lfobench.text import counted


def show(schedule: Schedule, out: Path) -> None:
    """Print the plan: a row per task, a column per method, what is done of each cell."""
    plan = schedule.plan
    methods = list(dict.fromkeys(cell.method.name for cell in plan.cells))
    done, wanted = (
        Counter((run.cell.task.name, run.cell.method.name) for run in runs) for runs in (schedule.done, plan.runs)
    )
    needs = schedule.needs
    lacking = [_lacking(needs[task.name]) for task in plan.tasks]
    headers = ["task", *map(escape, methods), *(["data it lacks"] if any(lacking) else [])]
    table = Table(*headers, title="Plan: runs done of runs wanted", title_style="bold")
    for task, lack in zip(plan.tasks, lacking, strict=True):
        cells = [(task.name, name) for name in methods]
        counts = (f"{done[cell]}/{wanted[cell]}" if wanted[cell] else "" for cell in cells)
        table.add_row(escape(task.name), *counts, *([lack] if any(lacking) else []))
    output.print(table)
    protocol = plan.protocol
    reason = f" ({plan.protocol_reason})" if plan.protocol_reason else ""
    output.print(f"protocol  {protocol.name}{reason}: {protocol.summary}")
    for budget in dict.fromkeys(_budget(cell.protocol) for cell in plan.cells if cell.protocol != protocol):
        output.print(f"budget    the tasks' own: {budget}", soft_wrap=True)
    for name, value in asdict(protocol.assigned).items():
        if value is not None:
            output.print(f"{_ASSIGNED[name]:<9} {value:,}, set with --{name.replace('_', '-')}")
    if tuned := sum(cell.tuning is not None for cell in plan.cells):
        output.print(f"tuned     {tuned} of {len(plan.cells)} cells, as 'lfobench tune' chose")
    output.print(f"records   {escape(str(out))}", soft_wrap=True)
    if schedule.shards:
        shards = counted(len(schedule.shards), "shard")
        output.print(f"data      {shards} to build into {escape(str(schedule.cache))}", soft_wrap=True)
    if any(task.read_from is not None for task in plan.tasks):
        evaluated = ", ".join(dict.fromkeys(task.environment.id.rpartition(":")[2] for task in plan.tasks))
        output.print(f"source    {plan.cells[0].source}, evaluated on {escape(evaluated)}", soft_wrap=True)
    if plan.left_out:
        output.print(f"left out  tasks without data of this source: {escape(', '.join(plan.left_out))}", soft_wrap=True)
    boxes = scaled_actions(plan.tasks)
    for box in dict.fromkeys(boxes.values()):
        names = ", ".join(name for name, own in boxes.items() if own == box)
        output.print(f"actions   in {escape(f'{box.scaling}: {names}')}", soft_wrap=True)
    if absent := absent_files(plan.tasks):
        names = ", ".join(file.name for file in absent)
        output.print(f"files     {counted(len(absent), 'file')} to fetch: {escape(names)}", soft_wrap=True)


def show_forecast(schedule: Schedule, expected: Forecast) -> None:
    """Print the device with what runs on it at once, how much is left to do, and for how long; warnings first."""
    warn(expected.warnings)
    output.print(f"device    {schedule.plan.device}{_arrangement(schedule)}")
    if schedule.pending:
        left = f"{len(schedule.pending)} of {len(schedule.plan.runs)} runs"
        output.print(f"to do     {left}, about {duration(expected.total_seconds)}")
    else:
        output.print(f"to do     nothing: all {len(schedule.plan.runs)} runs are done")


def scaled_actions(tasks: Sequence[Task]) -> dict[str, ActionBox]:
    """The box of every task whose environment takes other actions than those in [-1, 1]."""
    boxes = {task.name: task.environment.spaces.actions for task in tasks}
    return {name: box for name, box in boxes.items() if not box.is_unit}


_ASSIGNED = {
    "steps": "steps",
    "evaluation_every": "interval",
    "evaluation_episodes": "episodes",
    "final_episodes": "final",
}
"""Headings of what the user decided."""


def _lacking(needs: Needs) -> str:
    counts = (("shard", needs.shards), ("file", len(needs.files)))
    return ", ".join(counted(count, what) for what, count in counts if count)


def _budget(protocol: Protocol) -> str:
    """Description of a task's own budget."""
    methods = "" if protocol.methods_as is None else f", methods set as for '{protocol.methods_as}'"
    further = f" and at the end {protocol.further_episodes} more" if protocol.further_episodes else ""
    return (
        f"{protocol.steps:,} steps, every {protocol.evaluation_every:,} an evaluation of "
        f"{protocol.evaluation_episodes} episodes{further}{methods}"
    )


def _arrangement(schedule: Schedule) -> str:
    """Description of how the jobs share the machine."""
    at_once = f", {schedule.workers} job{'s' if schedule.workers > 1 else ''} at once"
    threads = max((job.threads for job in schedule.jobs), default=1)
    evaluators = max((job.evaluators for job in schedule.jobs), default=0)
    return (
        at_once
        + (f", up to {threads} threads each" if threads > 1 else "")
        + (
            f", evaluated beside them by {evaluators} process{'es' if evaluators > 1 else ''} each"
            if evaluators
            else ""
        )
    )


def as_json(schedule: Schedule, expected: Forecast) -> dict[str, Any]:
    """The plan for scripts."""
    return {
        "suite": schedule.plan.suite.name,
        "protocol": schedule.plan.protocol.name,
        "protocol_reason": schedule.plan.protocol_reason,
        "assigned": asdict(schedule.plan.protocol.assigned),
        "tasks_left_out": list(schedule.plan.left_out),
        "device": schedule.plan.device,
        "workers": schedule.workers,
        "shards_to_build": len(schedule.shards),
        "data_lacking": {task: asdict(needs) for task, needs in schedule.needs.items()},
        "estimated_seconds": round(expected.total_seconds, 1),
        "action_boxes": {name: box.identity for name, box in scaled_actions(schedule.plan.tasks).items()},
        "warnings": [warning.model_dump() for warning in expected.warnings],
        "runs": [
            {
                "method": run.cell.method.name,
                "task": run.cell.task.name,
                "seed": run.seed,
                "tuned": dict(run.cell.tuned),
                "identity": run.identity_hash,
                "done": done,
            }
            for runs, done in ((schedule.done, True), (schedule.pending, False))
            for run in runs
        ],
    }


def plain(value: Any) -> Any:
    """A dataclass as plain JSON data; None stays None."""
    return None if value is None else asdict(value)
