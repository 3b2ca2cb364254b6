"""``lfobench table``, ``compare`` and ``audit``: tables of records, and of publications."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import output
from lfobench.cli.options import printed_warnings, warn
from lfobench.tables.exporters import FORMATS

if TYPE_CHECKING:
    from lfobench.selection import Selection


TERMINAL = "terminal"

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
"""Options that decide numbers and highlights, by parameter; outcomes have neither."""


def table(
    context: typer.Context,
    out: options.Out = options.DEFAULT_OUT,
    format_name: Annotated[
        str, typer.Option("--format", help=f"How to print: {', '.join([TERMINAL, *FORMATS])}.")
    ] = TERMINAL,
    outcomes: Annotated[
        bool, typer.Option("--outcomes", help="How the episodes ended instead: success, or which failure. Not in HTML.")
    ] = False,
    statistic: options.StatisticName = None,
    test: options.TestName = None,
    scope: options.ScopeName = "group",
    correction: options.CorrectionName = "none",
    alpha: options.Alpha = 0.05,
    suite: options.SuiteFilter = None,
    protocol: options.ProtocolFilter = None,
    steps: options.StepsFilter = None,
    source: options.SourceFilter = None,
    preset: options.PresetFilter = None,
    methods: options.MethodsFilter = None,
    starts: options.StartsName = "all",
    against: Annotated[
        str | None,
        typer.Option(help="A publication, e.g. dilo-2024: its numbers in columns after ours, each compared with ours."),
    ] = None,
    margin: Annotated[float, typer.Option(help="Points within which a score matches the published one.")] = 5.0,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Show published numbers of another source or protocol, labelled as such.")
    ] = False,
    wide: Annotated[
        bool, typer.Option("--wide", help="Intervals and counts in every cell, however wide the table gets.")
    ] = False,
) -> None:
    """Mean ± std over seeds, or successes/episodes, the supported winners highlighted, a footnote that defines it all.

    Example: lfobench table --out runs --format latex > table.tex
    """
    from lfobench import api
    from lfobench.tables.exporters import check_format, export
    from lfobench.tables.exporters.terminal import terminal

    if outcomes:
        _check_outcomes(context, format_name)
    elif format_name != TERMINAL:
        check_format(format_name)
    selected = options.select_records(out, suite, protocol, steps, source, preset, methods, starts)
    if outcomes:
        _print_outcomes(selected, format_name)
        return
    built = selected.table(*api.knobs(selected.records, statistic, test, scope, correction, alpha))
    if against is not None:
        built = api.compare_with_publication(built, against, margin, anyway)
    if format_name == TERMINAL:
        output.print(terminal(built, wide))
    else:
        output.out(export(built, format_name), end="", highlight=False)


def _check_outcomes(context: typer.Context, format_name: str) -> None:
    """Refuse what plays no part in outcomes, before anything is read."""
    from lfobench.errors import UserError
    from lfobench.tables.outcomes import check_format

    for name, option in _OF_NUMBERS.items():
        if (source := context.get_parameter_source(name)) is not None and source.name == "COMMANDLINE":
            raise UserError(f"--outcomes counts how episodes ended, in which {option} plays no part.", "Leave one out.")
    if format_name != TERMINAL:
        check_format(format_name)


def _print_outcomes(selected: Selection, format_name: str) -> None:
    from lfobench.tables.outcomes import document, export_outcomes

    found = selected.outcomes()
    if format_name == TERMINAL:
        output.print(document(found))
    else:
        output.out(export_outcomes(found, format_name), end="", highlight=False)


AnyCorrection = Annotated[
    str,
    typer.Option(
        help="For the number of cells compared: none, holm or bh. Holm, because a gate over many cells would otherwise "
        "raise false alarms."
    ),
]


def compare(
    first: Annotated[str, typer.Argument(metavar="A", help="A method among the records of --out, or a folder.")],
    second: Annotated[str, typer.Argument(metavar="B", help="Another method, or the folder to judge against A.")],
    out: options.Out = options.DEFAULT_OUT,
    allow: Annotated[
        list[str] | None,
        typer.Option(help="Condition in which two folders may differ, e.g. simulator or protocol.steps; repeatable."),
    ] = None,
    statistic: options.StatisticName = None,
    test: options.TestName = None,
    correction: AnyCorrection = "holm",
    alpha: options.Alpha = 0.05,
    suite: options.SuiteFilter = None,
    protocol: options.ProtocolFilter = None,
    steps: options.StepsFilter = None,
    source: options.SourceFilter = None,
    preset: options.PresetFilter = None,
    as_json: options.Json = False,
) -> None:
    """Better, worse or undecided, task by task: method A against B, or folder B against A.

    Two folders are a regression gate: exit code 1 says that B is worse on some cell.

    Versions and configurations of two folders may differ, and are listed; conditions only with --allow.

    A cell that only A has cannot be judged: it is a warning.

    Example: lfobench compare dilo smodice --out runs

    Example: lfobench compare runs-before runs-after --json
    """
    from lfobench import api
    from lfobench.analyses.compare import warnings_of
    from lfobench.analyses.compare_formats import document, json_comparison

    with printed_warnings():
        compared = api.compare(
            first,
            second,
            out,
            allow=allow or (),
            statistic=statistic,
            test=test,
            correction=correction,
            alpha=alpha,
            suite=suite,
            protocol=protocol,
            steps=steps,
            source=source,
            preset=preset,
        )
    warn(warnings_of(compared))
    if as_json:
        output.out(json_comparison(compared), end="", highlight=False)
    else:
        output.print(document(compared))
    if compared.regressed:
        raise typer.Exit(1)


class AuditFormat(StrEnum):
    """Values of ``--format``."""

    terminal = "terminal"
    markdown = "markdown"
    json = "json"


class CountTestName(StrEnum):
    """Values of ``--count-test``."""

    fisher = "fisher"
    boschloo = "boschloo"


class CorrectionName(StrEnum):
    """Values of ``--correction``."""

    none = "none"
    holm = "holm"
    bh = "bh"


def audit(
    file: Annotated[
        str,
        typer.Argument(
            help="A shipped publication, e.g. dilo-2024; or a CSV file with the columns method, mean, std "
            "[, n, highlighted] or method, successes, trials [, highlighted], all others naming the row."
        ),
    ],
    n: Annotated[
        str | None, typer.Option("--n", help="Samples behind each mean, e.g. 5,7. Default: as the file states.")
    ] = None,
    methods: Annotated[
        str | None, typer.Option(help="Comma-separated methods that compete. Default: as the paper says, else all.")
    ] = None,
    test: Annotated[str, typer.Option(help="Best against second best, for means: welch or student.")] = "welch",
    count_test: Annotated[
        CountTestName, typer.Option("--count-test", help="The same for successes out of trials.")
    ] = CountTestName.fisher,
    correction: Annotated[
        CorrectionName, typer.Option(help="Of the rule, for the number of rows; Holm's and BH's p are shown anyway.")
    ] = CorrectionName.none,
    alpha: Annotated[float, typer.Option(help="Level of the test.")] = 0.05,
    format_name: Annotated[AuditFormat, typer.Option("--format", help="How to print.")] = AuditFormat.terminal,
) -> None:
    """Which highlights of a published table follow from its numbers, which survive a correction, what contradicts.

    Example: lfobench audit dilo-2024
    """
    from lfobench import api
    from lfobench.analyses.audit import document, json_audit
    from lfobench.cells.names import split_names

    found = api.audit(
        file,
        sizes=_sizes(n),
        methods=split_names(methods or ""),
        test=test,
        count_test=count_test.value,
        correction=correction.value,
        alpha=alpha,
    )
    if format_name is AuditFormat.terminal:
        output.print(document(found))
    else:
        text = document(found).markdown() if format_name is AuditFormat.markdown else json_audit(found)
        output.out(text, end="", highlight=False)


def _sizes(text: str | None) -> list[int]:
    """The numbers of ``--n``.

    Raises:
        UserError: they are none.
    """
    from lfobench.errors import UserError

    parts = [] if text is None else [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdigit() and len(part) < 10 and int(part) >= 2 for part in parts):
        raise UserError(
            f"--n '{text}' is not a list of numbers of samples, each at least 2.", "Write, for example, --n 5,7."
        )
    return list(map(int, parts))
