"""``lfobench table``: the table that a paper would print."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from lfobench.cli import options, selection
from lfobench.cli.console import output

if TYPE_CHECKING:
    from lfobench.api import Selection


class Format(StrEnum):
    """What ``--format`` takes."""

    terminal = "terminal"
    markdown = "markdown"
    latex = "latex"
    csv = "csv"
    json = "json"
    html = "html"


_OF_NUMBERS = {
    "statistic": "--stat",
    "test": "--test",
    "scope": "--scope",
    "correction": "--correction",
    "alpha": "--alpha",
    "against": "--against",
    "margin": "--margin",
    "anyway": "--anyway",
}
"""Options that decide numbers and highlights, by parameter; how episodes ended has neither."""


def table(
    context: typer.Context,
    out: options.Out = options.DEFAULT_OUT,
    format_name: Annotated[Format, typer.Option("--format", help="How to print.")] = Format.terminal,
    outcomes: Annotated[
        bool, typer.Option("--outcomes", help="How the episodes ended instead: success, or which failure. Not in HTML.")
    ] = False,
    statistic: selection.StatisticName = None,
    test: selection.TestName = None,
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
    margin: Annotated[float, typer.Option(help="Points within which a score matches the published one.")] = 5.0,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Show published numbers of another source or protocol, labelled as such.")
    ] = False,
) -> None:
    """Mean ± std over seeds, or successes/episodes, the supported winners highlighted, a footnote that defines it all.

    Example: lfobench table --out runs --format latex > table.tex
    """
    from lfobench import api
    from lfobench.tables.exporters.formats import export
    from lfobench.tables.exporters.terminal import terminal

    if outcomes:
        _check_outcomes(context, format_name)
    selected = selection.select_records(out, suite, protocol, steps, source, preset, methods)
    if outcomes:
        _print_outcomes(selected, format_name)
        return
    built = selected.table(*api.knobs(selected.records, statistic, test, scope, correction, alpha))
    if against is not None:
        built = api.hold_against(built, against, margin, anyway)
    if format_name is Format.terminal:
        output.print(terminal(built))
    else:
        output.out(export(built, format_name.value), end="", highlight=False)


def _check_outcomes(context: typer.Context, format_name: Format) -> None:
    """Refuse what plays no part in outcomes, before anything is read."""
    from lfobench.errors import UserError
    from lfobench.tables.outcomes import check_format

    for name, option in _OF_NUMBERS.items():
        if (source := context.get_parameter_source(name)) is not None and source.name == "COMMANDLINE":
            raise UserError(f"--outcomes counts how episodes ended, in which {option} plays no part.", "Leave one out.")
    if format_name is not Format.terminal:
        check_format(format_name.value)


def _print_outcomes(selected: Selection, format_name: Format) -> None:
    from lfobench.tables.outcomes import export_outcomes, terminal_outcomes

    found = selected.outcomes()
    if format_name is Format.terminal:
        output.print(terminal_outcomes(found))
    else:
        output.out(export_outcomes(found, format_name.value), end="", highlight=False)
