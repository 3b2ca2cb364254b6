"""``lfobench data``: files and generated data: what is there, and making what is not."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from lfobench.cli import data_files, data_listing, options
from lfobench.cli.console import INTERRUPTED, output, print_json
from lfobench.cli.doctor import doctor

app = typer.Typer(name="data", help="Datasets: what is needed and here, fetch, check, build.", no_args_is_help=True)
app.command(name="ls")(data_listing.list_files)
app.command()(data_files.download)
app.command()(data_files.verify)
app.command()(doctor)
app.command(name="rm")(data_files.remove)


@app.command()
def build(
    suite: data_files.SuiteArgument,
    tasks: options.Tasks = None,
    protocol: options.ProtocolName = "auto",
    source: options.Source = "auto",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes. Default: one per core.")] = None,
) -> None:
    """Make a suite's data once, or read it from files, into the cache (LFOBENCH_CACHE overrides where); resumable.

    Example: lfobench data build locomotion --tasks 'hopper-*' --protocol quick
    """
    from lfobench.cli.inputs import suite_and_tasks
    from lfobench.cli.progress import Terminal, stopping
    from lfobench.data.requested import asked_data
    from lfobench.files import writable_folder
    from lfobench.processes import available_cores
    from lfobench.schedule.execution import StopRequest, build_data

    asked = asked_data(*suite_and_tasks(suite, tasks), protocol, source)
    writable_folder(asked.cache, "LFOBENCH_CACHE")
    shards = asked.missing_shards()
    stop = StopRequest(stopping)
    with stop.listening():
        build_data(shards, workers or available_cores(), stop, Terminal())
    if stop():
        output.print("Stopped. The same command continues from here.")
        raise typer.Exit(INTERRUPTED)
    asked.check_files()
    if not shards:
        output.print("Nothing to build: every shard is there.")


def _amount(row: dict[str, Any]) -> str:
    return f"{row['transitions']:,}" if row["episodes"] is None else f"{row['episodes']} episodes"


@app.command()
def status(
    suite: data_files.SuiteArgument = options.DEFAULT_SUITE,
    tasks: options.Tasks = None,
    protocol: options.ProtocolName = "auto",
    source: options.Source = "auto",
    as_json: options.Json = False,
) -> None:
    """What each task of a suite needs and how much of it is in the cache.

    Example: lfobench data status locomotion --protocol paper
    """
    from rich.markup import escape
    from rich.table import Table

    from lfobench.cli.inputs import suite_and_tasks
    from lfobench.data.requested import asked_data

    asked = asked_data(*suite_and_tasks(suite, tasks), protocol, source)
    rows = asked.rows()
    if as_json:
        print_json(rows)
        return
    table = Table("task", "part", "amount", "shards there", title="Data in the cache", title_style="bold")
    for row in rows:
        there = f"{row['shards_present']}/{row['shards']}"
        table.add_row(escape(row["task"]), row["part"], _amount(row), there)
    output.print(table)
    output.print(f"in {escape(str(asked.cache))}", soft_wrap=True)
