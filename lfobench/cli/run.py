"""``lfobench run``: print the plan, build what data is missing, train what is not done."""

from __future__ import annotations

from typing import Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import errors, output, print_json
from lfobench.cli.options import choices_in, request, warn


def run(
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
    rerun: Annotated[
        bool, typer.Option("--rerun", help="Train anew what is done; the old records are kept aside, below --out.")
    ] = False,
    workers: options.Workers = None,
    out: options.Out = options.DEFAULT_OUT,
    no_wait: options.NoWait = False,
    dry_run: options.DryRun = False,
    as_json: options.Json = False,
) -> None:
    """Train methods on tasks over seeds; the same command finishes what is missing and redoes nothing.

    Example: lfobench run --methods dilo,smodice --suite locomotion --tasks 'hopper-*' --seeds 0-2
    """
    from rich.markup import escape

    from lfobench.cells.cell import Assigned
    from lfobench.cli import planned
    from lfobench.cli.progress import carry_out
    from lfobench.records.folder import ASIDE, read_folder
    from lfobench.schedule.execution import remove_checkpoints_of_the_finished
    from lfobench.schedule.jobs import arranged, forecast, resolve, within_memory
    from lfobench.text import counted

    assigned = Assigned(steps, evaluation_every, evaluation_episodes, final_episodes)
    wanted = request(methods, suite, tasks, seeds, protocol, preset, assign, source, device, assigned, precision, grid)
    plan = resolve(wanted, choices_in(out, tuned, grid))
    read = read_folder(out)
    warn(read.warnings)
    todo = arranged(plan, read, out, workers, rerun)
    if not as_json:
        planned.show(todo, out)
    with errors.status("Measuring this machine…"):
        todo = within_memory(todo, workers)
        expected = forecast(todo)
    if as_json:
        print_json(planned.as_json(todo, expected))
    else:
        planned.show_forecast(todo, expected)
        if todo.again:
            done = counted(len(todo.again), "run")
            output.print(f"rerun     {done} done before, to be set aside in {escape(str(out / ASIDE))}", soft_wrap=True)
    if dry_run:
        return
    if not todo.jobs:
        remove_checkpoints_of_the_finished(todo, out)
        return
    again = "The same command without --rerun" if rerun else "The same command"
    code = carry_out(todo, expected, out, quiet=as_json, wait=not no_wait, again=again)
    if code == 0 and not as_json:
        errors.print(f"Done. Next: lfobench table --out {escape(str(out))}", soft_wrap=True)
    raise typer.Exit(code)
