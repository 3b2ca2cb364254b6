"""The command line: parse, call, render. Heavy imports happen inside the commands, so that help is instant."""

from __future__ import annotations

import os
import sys

import typer

from lfobench import lazy_torch
from lfobench.cli import (
    audit,
    check,
    compare,
    data,
    ls,
    new,
    plan_seeds,
    plot,
    records,
    report,
    run,
    show,
    table,
    tune,
    video,
)
from lfobench.cli.console import errors, guarded_streams, one_line
from lfobench.errors import UserError

app = typer.Typer(
    name="lfobench",
    help="Compare offline learning-from-observation methods: train, evaluate, print the table.",
    epilog="Start with: lfobench run --methods dilo,bc --suite locomotion --tasks 'hopper-random-expert' --dry-run",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command(name="ls")(ls.list_names)
app.command(name="show")(show.show)
app.command(name="check")(check.check)
app.add_typer(new.app, name="new")
app.add_typer(data.app, name="data")
app.command(name="run")(run.run)
app.command(name="tune")(tune.tune)
app.command(name="status")(records.status)
app.command(name="why")(records.why)
app.command(name="table")(table.table)
app.command(name="plot")(plot.plot)
app.command(name="video")(video.video)
app.command(name="report")(report.report)
app.command(name="compare")(compare.compare)
app.command(name="audit")(audit.audit)
app.command(name="plan")(plan_seeds.plan)


READING = {"ls", "show", "status", "why", "data"}
"""Commands that load methods or the engine, whose files import torch, and need nothing of it."""


def main() -> None:
    """Entry point of ``lfobench``: a user's mistake is one line and exit code 2, never a traceback."""
    # One thread per process: seeds are spread over processes, and a second busy thread only slows the first.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if sys.argv[1:2] and (sys.argv[1] in READING or "--dry-run" in sys.argv):
        lazy_torch.install()
    try:
        with guarded_streams():
            app()
    except UserError as error:
        with guarded_streams():
            errors.print(f"[bold red]Error:[/] {one_line(str(error))}", soft_wrap=True)
        sys.exit(2)
