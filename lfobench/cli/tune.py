"""``lfobench tune``: choose hyperparameters from grids, away from the starts of the tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from lfobench.cli import options
from lfobench.cli.console import errors, output, print_json
from lfobench.cli.options import request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lfobench.cells.plan import Plan
    from lfobench.cells.tuning import Search
    from lfobench.records.folder import RecordFolder, RecordsRead
    from lfobench.records.tuning import Choice, TuningFolder

SEEDS = "1000"
"""Seeds of the trials, which are in no table unless asked for."""


def tune(
    methods: Annotated[
        str | None,
        typer.Option(
            help="Comma-separated methods. Default: those of --grid, or all that the tasks declare a grid for."
        ),
    ] = None,
    suite: options.SuiteName = options.DEFAULT_SUITE,
    tasks: options.Tasks = None,
    seeds: Annotated[str, typer.Option(help="Of every trial: numbers and ranges, e.g. 1000-1002.")] = SEEDS,
    starts: Annotated[
        int, typer.Option(min=1, help="Validation starts of every trial; never those of the tests.")
    ] = 20,
    protocol: options.ProtocolName = "auto",
    steps: options.Steps = None,
    preset: options.Preset = "released",
    assign: options.Assignments = None,
    grid: options.Grid = None,
    source: options.Source = "auto",
    device: options.Device = "auto",
    precision: options.Precision = "auto",
    workers: options.Workers = None,
    out: options.Out = options.DEFAULT_OUT,
    no_wait: options.NoWait = False,
    dry_run: options.DryRun = False,
    as_json: options.Json = False,
) -> None:
    """Train every combination of a grid and choose the best; 'lfobench run --tuned' then takes those values.

    The grid is a suite's or a method's own, or yours, for any method on any suite.

    Example: lfobench tune --grid dilo.tau=0.03,0.1,0.3 --suite locomotion --tasks 'hopper-*' --starts 20
    """
    from dataclasses import replace

    from lfobench.cells.cell import Assigned
    from lfobench.cells.tuning import searches
    from lfobench.cli import planned
    from lfobench.cli.progress import carry_out
    from lfobench.files import remove_leftovers
    from lfobench.records.tuning import TuningFolder
    from lfobench.schedule.jobs import arranged, forecast, resolve, within_memory

    named = methods if methods is not None else _all_with_grids(suite, tasks, grid or ())
    assigned = Assigned(steps)
    wanted = request(named, suite, tasks, seeds, protocol, preset, assign, source, device, assigned, precision, grid)
    plan = resolve(wanted)
    found = searches(plan, wanted)
    trials = replace(plan, cells=tuple(trial for search in found for trial in search.trials(starts)))
    folder = TuningFolder(out)
    todo = arranged(trials, _finished(folder.trials, trials), folder.trials.root, workers)
    if not as_json:
        planned.show(todo, folder.trials.root)
    with errors.status("Measuring this machine…"):
        todo = within_memory(todo, workers)
        expected = forecast(todo)
    if not as_json:
        planned.show_forecast(todo, expected)
    elif dry_run:
        print_json(planned.as_json(todo, expected))
    if dry_run:
        return
    code = carry_out(todo, expected, folder.trials.root, quiet=as_json, wait=not no_wait) if todo.jobs else 0
    remove_leftovers(folder.trials.root)
    choices = _choose(folder, found, starts, plan.seeds)
    if as_json:
        print_json([_as_json(folder, search, choice) for search, choice in choices])
    elif choices:
        _show(choices, folder)
    if code == 0 and not as_json:
        errors.print("Done. Next: lfobench run --tuned, with the same tasks, protocol, preset and --out.")
    raise typer.Exit(code)


def _all_with_grids(suite: str, tasks: str | None, grids: Sequence[str]) -> str:
    """The methods that ``--grid`` names, or else any of the tasks declares a grid for, as ``--methods`` takes them."""
    from lfobench.cells.names import chosen_tasks
    from lfobench.cells.tuning import methods_with_grids
    from lfobench.errors import UserError
    from lfobench.registry import load_suite

    if grids:
        return ",".join(dict.fromkeys(grid.partition(".")[0] for grid in grids))
    loaded = load_suite(suite)
    found = methods_with_grids(chosen_tasks(loaded, tasks))
    if not found:
        raise UserError(
            f"Suite '{loaded.name}' declares no grid{'' if tasks is None else ' for these tasks'}.",
            "Say what to try, --grid METHOD.FIELD=V1,V2, or train with 'lfobench run'.",
        )
    return ",".join(found)


def _finished(trials: RecordFolder, plan: Plan) -> RecordsRead:
    """The trials that are there; as results, they would not be read at all."""
    from lfobench.records.folder import RecordsRead

    return RecordsRead([record for run in plan.runs if (record := trials.find(run)) is not None])


def _choose(
    folder: TuningFolder, found: Sequence[Search], starts: int, seeds: Sequence[int]
) -> list[tuple[Search, Choice]]:
    """The choices whose trials are all there, each written unless it is already."""
    from lfobench.records.tuning import choose

    choices = []
    for search in found:
        records = folder.trial_records(search, starts, seeds)
        if records is None:
            continue
        choice = choose(search, starts, records, folder.all_trials(search))
        if folder.find(search) != choice:
            folder.write(search, choice)
        choices.append((search, choice))
    return choices


def _as_json(folder: TuningFolder, search: Search, choice: Choice) -> dict[str, Any]:
    return {
        "task": search.cell.task.name,
        "method": search.cell.method.name,
        "file": str(folder.path(search)),
        "tuning": choice.tuning.model_dump(mode="json"),
        "trials": [{**trial.model_dump(mode="json"), "score": trial.score} for trial in choice.trials],
    }


def _show(choices: Sequence[tuple[Search, Choice]], folder: TuningFolder) -> None:
    from rich.markup import escape
    from rich.table import Table

    from lfobench.text import short_number

    table = Table(title="Choices", title_style="bold")
    for header in ("task", "method", "chosen", "score", "of all trials"):
        # Folded, never cut: a name that ends in dots cannot be typed.
        table.add_column(header, overflow="fold")
    for search, choice in choices:
        values = ", ".join(f"{field} = {value}" for field, value in choice.tuning.chosen.items())
        scores = [trial.score for trial in choice.trials]
        table.add_row(
            escape(search.cell.task.name),
            escape(search.cell.method.name),
            escape(values),
            short_number(choice.best.score),
            f"{short_number(min(scores))} to {short_number(max(scores))} ({len(scores)})",
        )
    output.print(table)
    output.print(f"in {escape(str(folder.trials.root))}; {choices[0][1].tuning.criterion}", soft_wrap=True)
