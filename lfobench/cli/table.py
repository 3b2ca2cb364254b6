"""``lfobench table``: the table that a paper would print."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from lfobench.cli import options, selection
from lfobench.cli.console import output


class Format(StrEnum):
    """What ``--format`` takes."""

    terminal = "terminal"
    markdown = "markdown"
    latex = "latex"
    csv = "csv"
    json = "json"
    html = "html"


def table(
    out: options.Out = options.DEFAULT_OUT,
    format_name: Annotated[Format, typer.Option("--format", help="How to print.")] = Format.terminal,
    statistic: selection.StatisticName = "last5",
    test: selection.TestName = "welch",
    scope: selection.ScopeName = "group",
    correction: selection.CorrectionName = "none",
    alpha: selection.Alpha = 0.05,
    suite: selection.SuiteFilter = None,
    protocol: selection.ProtocolFilter = None,
    steps: selection.StepsFilter = None,
    source: selection.SourceFilter = None,
    preset: selection.PresetFilter = None,
    methods: selection.MethodsFilter = None,
    against: Annotated[
        str | None, typer.Option(help="A publication, e.g. dilo-2024: its numbers beside ours, each with a verdict.")
    ] = None,
    margin: Annotated[float, typer.Option(help="Points within which a number matches the published one.")] = 5.0,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Show published numbers of another source or protocol, labelled as such.")
    ] = False,
) -> None:
    """Mean ± std over seeds, the supported winners highlighted, the footnote that defines every number.

    Example: lfobench table --out runs --format latex > table.tex
    """
    from lfobench import api
    from lfobench.contract.statistic import parse_statistic
    from lfobench.render.formats import export
    from lfobench.render.terminal import terminal

    rule = selection.make_rule(test, scope, correction, alpha)
    counted = parse_statistic(statistic)
    built = selection.select_records(out, suite, protocol, steps, source, preset, methods).table(counted, rule)
    if against is not None:
        built = api.hold_against(built, against, margin, anyway)
    if format_name is Format.terminal:
        output.print(terminal(built))
    else:
        output.out(export(built, format_name.value), end="", highlight=False)
