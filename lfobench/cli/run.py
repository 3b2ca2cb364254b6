"""``lfobench run``: print the plan, build what data is missing, train what is not done."""

from __future__ import annotations

from typing import Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import errors, print_json
from lfobench.cli.inputs import available_cores, read_folder, request, resolve, warn


def run(
    methods: options.Methods = options.DEFAULT_METHODS,
    suite: options.SuiteName = options.DEFAULT_SUITE,
    tasks: options.Tasks = None,
    seeds: options.Seeds = None,
    protocol: options.ProtocolName = "auto",
    steps: options.Steps = None,
    preset: options.Preset = "released",
    assign: options.Assignments = None,
    source: options.Source = "generated",
    device: options.Device = "auto",
    precision: options.Precision = "auto",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Jobs at once. Default: what the cores, or the device's memory, hold.")
    ] = None,
    out: options.Out = options.DEFAULT_OUT,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and stop.")] = False,
    as_json: options.Json = False,
) -> None:
    """Train methods on tasks over seeds; the same command finishes what is missing and redoes nothing.

    Example: lfobench run --methods dilo,smodice --suite locomotion --tasks 'hopper-*' --seeds 0-2
    """
    import torch

    from lfobench.cli import agenda, execution, packing, planned
    from lfobench.data.build import check_present
    from lfobench.engine.memory import memory_of
    from lfobench.engine.probe import Prober
    from lfobench.files import cache_folder, writable_folder
    from lfobench.plan.parts import build_command

    plan = resolve(request(methods, suite, tasks, seeds, protocol, preset, assign, source, device, steps, precision))
    read = read_folder(out)
    warn(read.warnings)
    todo = agenda.make_agenda(plan, read, out, cache_folder(), workers or available_cores())
    with errors.status("Measuring this machine…"):
        prober = Prober(plan.device)
        todo = packing.packed(todo, prober, memory_of(torch.device(plan.device)), available_cores(), workers)
        expected = agenda.forecast(todo, prober)
    if as_json:
        print_json(planned.as_json(todo, expected))
    else:
        planned.show(todo, expected, out)
    if dry_run or not todo.jobs:
        return
    with errors.status("Checking the data…"):
        check_present(todo.cache, todo.requests, lambda task: build_command(suite, plan.protocol.name, task))
    if todo.shards:
        writable_folder(todo.cache, "LFOBENCH_CACHE")
    writable_folder(out, "--out")
    raise typer.Exit(execution.carry_out_agenda(todo, expected, out, quiet=as_json))
