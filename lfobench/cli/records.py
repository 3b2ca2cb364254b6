"""``lfobench status`` and ``lfobench why``: what the records hold, and why a run is reused or runs again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lfobench.cli import options
from lfobench.cli.console import output, print_json
from lfobench.cli.inputs import choices_in, read_folder, request, resolve, warn

if TYPE_CHECKING:
    from lfobench.contract.record import Record


def status(out: options.Out = options.DEFAULT_OUT, as_json: options.Json = False) -> None:
    """What is in a folder of records: seeds done per cell, diverged seeds, runs in progress.

    Example: lfobench status --out runs
    """
    from rich.markup import escape
    from rich.table import Table

    from lfobench.store.folder import RecordFolder

    folder = RecordFolder(out)
    read = folder.read_all()
    cells: dict[tuple[str, ...], dict[str, list[int]]] = {}
    for record in read.records:
        key = (record.task, record.method, _variant(record), _budget(record))
        cells.setdefault(key, {"finished": [], "diverged": []})[record.status].append(record.seed)
    checkpoints = len(list((out / "checkpoints").glob("*.safetensors")))
    rows = [
        dict(zip(("task", "method", "preset", "protocol"), key, strict=True))
        | {name: sorted(seeds) for name, seeds in found.items()}
        for key, found in sorted(cells.items())
    ]
    warn(read.warnings)
    if as_json:
        print_json({"cells": rows, "runs_in_progress": checkpoints})
        return
    table = Table("task", "method", "preset", "protocol", "seeds finished", "seeds diverged")
    for row in rows:
        table.add_row(*(escape(_cell(value)) for value in row.values()))
    output.print(table)
    output.print(f"{len(read.records)} records, {checkpoints} runs interrupted or in progress")


def why(
    methods: options.Methods = options.DEFAULT_METHODS,
    suite: options.SuiteName = options.DEFAULT_SUITE,
    tasks: options.Tasks = None,
    seeds: options.Seeds = None,
    protocol: options.ProtocolName = "auto",
    steps: options.Steps = None,
    preset: options.Preset = "released",
    assign: options.Assignments = None,
    source: options.Source = "auto",
    device: options.Device = "auto",
    precision: options.Precision = "auto",
    tuned: options.Tuned = False,
    grid: options.Grid = None,
    out: options.Out = options.DEFAULT_OUT,
    as_json: options.Json = False,
) -> None:
    """For every run that a command line names: reused, or run again, and which fields of the identity decide it.

    Example: lfobench why --methods dilo --tasks hopper-random-expert --set dilo.tau=3
    """
    from rich.markup import escape

    from lfobench.data.source import declared_fingerprints
    from lfobench.files import cache_folder
    from lfobench.store.explain import explain

    wanted = request(methods, suite, tasks, seeds, protocol, preset, assign, source, device, steps, precision, grid)
    plan = resolve(wanted, choices_in(out, tuned, grid))
    read = read_folder(out)
    warn(read.warnings)
    in_cache = {
        task.name: declared_fingerprints(cache_folder(), plan.suite, task, plan.protocol.recipe_for(task))
        for task in plan.tasks
    }
    explanations = [explain(run, read.records, in_cache[run.cell.task.name]) for run in plan.runs]
    if as_json:
        print_json([explanation.as_json() for explanation in explanations])
        return
    for explanation in explanations:
        colour = "green" if explanation.reused else "yellow"
        output.print(f"[{colour}]{escape(explanation.headline)}[/]", soft_wrap=True)
        for difference in explanation.differences:
            output.print(f"    {escape(difference)}", soft_wrap=True)


def _variant(record: Record) -> str:
    """The preset, what was chosen, what ``--set`` changed, and which code of a method from elsewhere it was.

    For example ``released, tuned tau=2 mixture=0.5, discount=0.9, code 1a2b3c4``.
    """
    from lfobench.contract.identity import code_version

    code = code_version(record.identity)
    tuned, assigned = record.identity.get("tuned", {}), record.identity.get("set", {})
    chosen = " ".join(f"{field}={value}" for field, value in tuned.items())
    changes = [f"{field}={value}" for field, value in assigned.items()]
    return ", ".join(
        [
            str(record.identity["preset"]),
            *([f"tuned {chosen}"] if tuned else []),
            *changes,
            *([f"code {code}"] if code else []),
        ]
    )


def _budget(record: Record) -> str:
    """The protocol, with the steps if ``--steps`` chose them: ``quick, 24,000 steps``."""
    protocol = record.identity["protocol"]
    return f"{protocol['name']}, {protocol['steps']:,} steps" if protocol["steps_assigned"] else str(protocol["name"])


def _cell(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
