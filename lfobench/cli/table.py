"""``lfobench table``: the table that a paper would print."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import output
from lfobench.cli.inputs import warn


class Format(StrEnum):
    """What ``--format`` takes."""

    terminal = "terminal"
    markdown = "markdown"
    latex = "latex"
    csv = "csv"


class Statistic(StrEnum):
    """What ``--stat`` takes."""

    last5 = "last5"
    last = "last"
    best = "best"


def table(
    out: options.Out = options.DEFAULT_OUT,
    format_name: Annotated[Format, typer.Option("--format", help="How to print.")] = Format.terminal,
    statistic: Annotated[
        Statistic, typer.Option("--stat", help="Score of a run: mean of the last 5 evaluations, last, or best.")
    ] = Statistic.last5,
    alpha: Annotated[float, typer.Option(min=0.0, max=1.0, help="Level of the test behind the highlights.")] = 0.05,
    suite: Annotated[str | None, typer.Option(help="Only records of this suite (name, or path of its file).")] = None,
    protocol: Annotated[str | None, typer.Option(help="Only records of this protocol.")] = None,
    steps: Annotated[int | None, typer.Option(help="Only records of this many gradient steps.")] = None,
    source: Annotated[str | None, typer.Option(help="Only records of this source.")] = None,
    preset: Annotated[str | None, typer.Option(help="Only records of this preset.")] = None,
    methods: Annotated[str | None, typer.Option(help="Comma-separated methods, in column order.")] = None,
) -> None:
    """Mean ± std over seeds, the supported winners highlighted, the footnote that defines every number.

    Example: lfobench table --out runs --format latex > table.tex
    """
    from lfobench.errors import UserError, unknown_name
    from lfobench.plan.names import split_names
    from lfobench.registry import load_suite, suite_names
    from lfobench.render.building import build_table
    from lfobench.render.formats import export
    from lfobench.render.terminal import terminal
    from lfobench.store.folder import RecordFolder, select

    read = RecordFolder(out).read_all()
    warn(read.warnings)
    given = load_suite(suite) if suite is not None and suite.endswith(".py") else None
    name = given.name if given else suite
    records = select(read.records, suite=name, protocol=protocol, steps=steps, source=source, preset=preset)
    columns = split_names(methods or "")
    present = {record.method for record in records}
    for name in columns:
        if name not in present:
            raise unknown_name("method among these records", name, present)
    if read.records and not records:
        raise UserError(
            f"None of the {len(read.records)} records in {out} passes the filters.",
            f"'lfobench status --out {out}' lists what is there.",
        )
    if columns:
        records = [record for record in records if record.method in columns]
    present_suites = {record.labels.suite for record in records}
    known = [given] if given else [load_suite(name) for name in suite_names() if name in present_suites]
    tasks = [task.name for known_suite in known for task in known_suite.tasks]
    order = columns or options.DEFAULT_METHODS.split(",")
    built = build_table(records, statistic.value, alpha, tasks, order)
    if format_name is Format.terminal:
        output.print(terminal(built))
    else:
        output.out(export(built, format_name.value), end="", highlight=False)
