"""``lfobench run``: print the plan, build what data is missing, train what is not done."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import errors, print_json

if TYPE_CHECKING:
    from lfobench.plan.planning import Plan, Request


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
    workers: Annotated[int | None, typer.Option(min=1, help="Processes. Default: one per core on a CPU.")] = None,
    out: options.Out = options.DEFAULT_OUT,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and stop.")] = False,
    as_json: options.Json = False,
) -> None:
    """Train methods on tasks over seeds; the same command finishes what is missing and redoes nothing.

    Example: lfobench run --methods dilo,smodice --suite locomotion --tasks 'hopper-*' --seeds 0-2
    """
    from lfobench.cli import execution, planned
    from lfobench.data.build import check_present
    from lfobench.data.cache import cache_folder
    from lfobench.engine.probe import Prober
    from lfobench.files import writable_folder
    from lfobench.store.folder import RecordFolder

    plan = resolve(request(methods, suite, tasks, seeds, protocol, preset, assign, source, device, steps))
    folder = RecordFolder(out)
    count = workers or (1 if plan.device == "cuda" else available_cores())
    agenda = planned.agenda(plan, folder, cache_folder(), count)
    with errors.status("Measuring this machine…"):
        expected = planned.forecast(agenda, Prober(plan.device))
    if as_json:
        print_json(planned.as_json(agenda, expected))
    else:
        planned.show(agenda, expected, out)
    if dry_run or not agenda.pending:
        return
    if agenda.shards:
        writable_folder(agenda.cache, "LFOBENCH_CACHE")
    with errors.status("Checking the data…"):
        check_present(agenda.cache, suite, (part for _, part in agenda.requests))
    writable_folder(out, "--out")
    raise typer.Exit(execution.carry_out_agenda(agenda, expected, out, quiet=as_json))


def request(
    methods: str,
    suite: str,
    tasks: str | None,
    seeds: str | None,
    protocol: str,
    preset: str,
    assign: list[str] | None,
    source: str,
    device: str,
    steps: int | None,
) -> Request:
    """The options that ``run`` and ``why`` share, as one value."""
    from lfobench.plan.planning import Request

    return Request(methods, suite, tasks, seeds, protocol, preset, tuple(assign or ()), source, device, steps)


def resolve(wanted: Request) -> Plan:
    """Names to cells; torch is asked for CUDA only where it matters."""
    import torch

    from lfobench.plan.planning import make_plan

    return make_plan(wanted, torch.cuda.is_available)


def available_cores() -> int:
    """Cores that this process may use."""
    import os

    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
