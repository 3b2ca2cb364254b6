"""``lfobench status`` and ``lfobench why``: what the records hold, and why a run is reused or runs again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lfobench.cli import options
from lfobench.cli.console import one_line, output, print_json
from lfobench.cli.options import choices_in, request, warn

if TYPE_CHECKING:
    from lfobench.record import Failure, Record


ENDS = ("finished", "diverged", "crashed")
"""Ends of a run."""


def status(out: options.Out = options.DEFAULT_OUT, as_json: options.Json = False) -> None:
    """What is in a folder of records: seeds done per cell, diverged and crashed seeds, runs in progress.

    Example: lfobench status --out runs
    """
    from bisect import insort

    from lfobench.records.folder import RecordFolder, read_failures
    from lfobench.tables.document import Section, aligned

    folder = RecordFolder(out)
    read = folder.read_all()
    failures, unread = read_failures(folder, read.records)
    cells: dict[tuple[str, ...], dict[str, list[int]]] = {}
    ended: list[tuple[Record | Failure, str]] = [(record, record.status) for record in read.records]
    for run, how in [*ended, *((failure, "crashed") for failure in failures)]:
        key = (run.task, run.method, _variant(run), _budget(run))
        insort(cells.setdefault(key, {each: [] for each in ENDS})[how], run.seed)
    checkpoints = len(list((out / "checkpoints").glob("*.safetensors")))
    warn([*read.warnings, *unread])
    if as_json:
        names = ("task", "method", "preset", "protocol")
        rows = [{**dict(zip(names, key, strict=True)), **found} for key, found in sorted(cells.items())]
        print_json({"cells": rows, "runs_in_progress": checkpoints})
        return
    by_task: dict[str, list[list[str]]] = {}
    for (task, *what), found in sorted(cells.items()):
        by_task.setdefault(task, []).append([", ".join(what), *(", ".join(map(str, found[how])) for how in ENDS)])
    for text in aligned(ENDS, [Section(task, "bold", lines) for task, lines in by_task.items()], output.width):
        output.print(text, soft_wrap=True)
    crashed = f"{len(failures)} crashed runs, " if failures else ""
    output.print(f"{len(read.records)} records, {crashed}{checkpoints} runs interrupted or in progress")
    for failure in sorted(failures, key=lambda each: (each.task, each.method, each.seed)):
        message = f"{failure.method} on {failure.task}, seed {failure.seed}: {failure.error}"
        output.print(f"[red]Crashed:[/] {one_line(message)}", soft_wrap=True)
        for line in failure.place[-1:]:
            output.print(f"         {one_line(line)}", soft_wrap=True)


def why(
    methods: options.Methods = options.DEFAULT_METHODS,
    suite: options.SuiteName = options.DEFAULT_SUITE,
    tasks: options.Tasks = None,
    seeds: options.Seeds = None,
    protocol: options.ProtocolName = "auto",
    steps: options.Steps = None,
    evaluation_every: options.EvaluationEvery = None,
    evaluation_episodes: options.EvaluationEpisodes = None,
    final_episodes: options.FinalEpisodes = None,
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
    from lfobench.cells.cell import Assigned
    from lfobench.data.source import declared_fingerprints
    from lfobench.files import cache_folder
    from lfobench.records.folder import RecordFolder, explain, read_folder
    from lfobench.schedule.jobs import resolve

    assigned = Assigned(steps, evaluation_every, evaluation_episodes, final_episodes)
    wanted = request(methods, suite, tasks, seeds, protocol, preset, assign, source, device, assigned, precision, grid)
    plan = resolve(wanted, choices_in(out, tuned, grid))
    read = read_folder(out)
    warn(read.warnings)
    in_cache = {
        task.name: declared_fingerprints(cache_folder(), plan.suite, task, plan.protocol.recipe_for(task))
        for task in plan.tasks
    }
    folder = RecordFolder(out)
    explanations = [explain(run, read.records, in_cache[run.cell.task.name], folder.earlier(run)) for run in plan.runs]
    if as_json:
        print_json([explanation.as_json() for explanation in explanations])
        return
    for explanation in explanations:
        colour = "green" if explanation.reused else "yellow"
        output.print(f"[{colour}]{one_line(explanation.headline)}[/]", soft_wrap=True)
        for difference in explanation.differences:
            output.print(f"    {one_line(difference)}", soft_wrap=True)


def _variant(record: Record | Failure) -> str:
    """The preset, what was chosen, what ``--set`` changed, and which code of a method from elsewhere it was.

    For example ``released, tuned tau=2 mixture=0.5, discount=0.9, code 1a2b3c4``.
    """
    from lfobench.record import code_version

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


def _budget(record: Record | Failure) -> str:
    """The protocol, with the steps if ``--steps`` chose them: ``quick, 24,000 steps``."""
    protocol = record.identity["protocol"]
    return f"{protocol['name']}, {protocol['steps']:,} steps" if protocol["steps_assigned"] else str(protocol["name"])
