"""The command line: parse, call, render. Heavy imports happen inside the commands, so that help is instant."""

from __future__ import annotations

import os
import sys

import typer

from lfobench import lazy_torch
from lfobench.cli import data, figures, methods, power, records, run, show, tables, tune
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
app.command(name="ls")(show.list_names)
app.command(name="show")(show.show)
app.command(name="check")(methods.check)
app.add_typer(methods.app, name="new")
app.add_typer(data.app, name="data")
app.command(name="run")(run.run)
app.command(name="tune")(tune.tune)
app.command(name="status")(records.status)
app.command(name="why")(records.why)
app.command(name="table")(tables.table)
app.command(name="plot")(figures.plot)
app.command(name="video")(figures.video)
app.command(name="report")(figures.report)
app.command(name="compare")(tables.compare)
app.command(name="audit")(tables.audit)
app.command(name="power")(power.power_of_seeds)


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
