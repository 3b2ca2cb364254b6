"""``lfobench table``, ``compare`` and ``audit``: tables of records, and of publications."""

from __future__ import annotations

import os
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from lfobench.cli import options
from lfobench.cli.console import output
from lfobench.cli.options import warn
from lfobench.tables.exporters import FORMATS

if TYPE_CHECKING:
    from lfobench.api import Selection
    from lfobench.records.publication import Publication
    from lfobench.stats.highlight import Rule
    from lfobench.stats.options import Correction


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
    from lfobench.analyses.compare import NamedRuns, pair_folders, pair_methods, warnings_of
    from lfobench.analyses.compare import compare as judge
    from lfobench.analyses.compare_formats import document, json_comparison
    from lfobench.errors import UserError
    from lfobench.tables.counting import knobs

    filters = (suite, protocol, steps, source, preset)
    folders = _are_folders(first, second)
    if allow and not folders:
        raise UserError(
            "--allow is for two folders: methods of one folder are compared under the same conditions.",
            "Leave it out, or put their records into two folders.",
        )
    selected = [_selected(Path(name), filters) for name in ((first, second) if folders else (out,))]
    scored, rule = knobs(
        [each for found in selected for each in found.records], statistic, test, "all", correction, alpha
    )
    if folders:
        reference, subject = (
            NamedRuns(name, heading, found.records, found.failures)
            for name, heading, found in zip((first, second), "AB", selected, strict=True)
        )
        tasks = list(dict.fromkeys(task for found in selected for task in found.tasks))
        pairing = pair_folders(reference, subject, scored, tasks, allow or [], rule)
    else:
        (found,) = selected
        pairing = pair_methods(found.records, found.failures, first, second, scored, found.tasks, rule)
    compared = judge(pairing, rule, scored)
    warn(warnings_of(compared))
    if as_json:
        output.out(json_comparison(compared), end="", highlight=False)
    else:
        output.print(document(compared))
    if compared.regressed:
        raise typer.Exit(1)


_Filters = tuple[str | None, str | None, int | None, str | None, str | None]


def _are_folders(first: str, second: str) -> bool:
    """Whether both names are folders; refuses one folder, and what can only be a folder and is not there."""
    from lfobench.errors import UserError

    folders = [_is_folder(name) for name in (first, second)]
    if all(folders):
        return True
    if not any(folders) and os.sep not in first + second:
        return False
    missing = [name for name, there in zip((first, second), folders, strict=True) if not there]
    raise UserError(
        f"'{missing[0]}' is no folder"
        + (f", and '{second if missing[0] == first else first}' is one." if any(folders) else "."),
        "Name two folders of records, or two methods of the folder that --out names.",
    )


def _is_folder(name: str) -> bool:
    try:
        return Path(name).is_dir()
    except OSError:
        return False


def _selected(out: Path, filters: _Filters) -> Selection:
    """The records of a folder, of which there must be some."""
    from lfobench.errors import UserError

    found = options.select_records(out, *filters)
    if not found.records:
        raise UserError(f"{out} holds no records.", "Run 'lfobench run' first, or name another folder.")
    return found


_MOST_TRIALS_OF_BOSCHLOO = 1000


class AuditFormat(StrEnum):
    """What ``--format`` takes."""

    terminal = "terminal"
    markdown = "markdown"
    json = "json"


class CountTestName(StrEnum):
    """What ``--count-test`` takes."""

    fisher = "fisher"
    boschloo = "boschloo"


class CorrectionName(StrEnum):
    """What ``--correction`` takes."""

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
    from lfobench.analyses.audit import Audit, document, json_audit
    from lfobench.records.publication import TableOfMeans
    from lfobench.records.published import read_publication
    from lfobench.stats.audit import CountsRule, audit_counts, audit_means

    rule = _rule(test, correction.value, alpha)
    counts_rule = CountsRule(count_test.value, rule.correction, rule.alpha)
    publication = read_publication(file)
    sizes, chosen = _sizes(n, publication), _methods(methods, publication)
    audits = []
    if count_test is CountTestName.boschloo:
        _check_trials(publication)
    for table in publication.tables:
        compared = [method for method in chosen if method in table.methods] or table.compared or table.methods
        if chosen and not set(chosen) & set(table.methods):
            continue
        audits.append(
            audit_means(table, compared, rule, sizes)
            if isinstance(table, TableOfMeans)
            else audit_counts(table, compared, counts_rule)
        )
    found = Audit(publication, tuple(audits))
    if format_name is AuditFormat.terminal:
        output.print(document(found))
    else:
        text = document(found).markdown() if format_name is AuditFormat.markdown else json_audit(found)
        output.out(text, end="", highlight=False)


def _check_trials(publication: Publication) -> None:
    """Boschloo's test looks at every pair of counts, so its memory grows with the product of the trials."""
    from lfobench.errors import UserError
    from lfobench.records.publication import TableOfCounts

    counts = [table for table in publication.tables if isinstance(table, TableOfCounts)]
    most = max((cell.trials for table in counts for row in table.rows for cell in row.cells.values()), default=0)
    if most > _MOST_TRIALS_OF_BOSCHLOO:
        raise UserError(
            f"Boschloo's test is too costly for {most:,} trials (at most {_MOST_TRIALS_OF_BOSCHLOO:,}).",
            "Use --count-test fisher.",
        )


def _rule(test: str, correction: Correction, alpha: float) -> Rule:
    from lfobench.errors import UserError, unknown_name
    from lfobench.stats.highlight import Rule
    from lfobench.stats.options import Test
    from lfobench.stats.tests import FROM_SUMMARIES

    chosen = next((known for known in FROM_SUMMARIES if known == test), None)
    if chosen is None:
        if test not in get_args(Test):
            raise unknown_name("test", test, FROM_SUMMARIES)
        raise UserError(
            f"'{test}' needs every score, and a published table holds only n, mean and standard deviation.",
            f"Choose {' or '.join(sorted(FROM_SUMMARIES, reverse=True))}.",
        )
    if not 0.0 < alpha < 1.0:
        raise UserError(f"alpha = {alpha:g} is not a level that a test can have.", "Choose one such as 0.05.")
    return Rule(chosen, correction=correction, alpha=alpha)


def _sizes(text: str | None, publication: Publication) -> list[int]:
    from lfobench.errors import UserError
    from lfobench.records.publication import TableOfMeans

    if text is None:
        return []
    parts = [part.strip() for part in text.split(",")]
    # Nine digits: far more than any table has, and few enough for every formula.
    if not all(part.isascii() and part.isdigit() and len(part) < 10 and int(part) >= 2 for part in parts):
        raise UserError(
            f"--n '{text}' is not a list of numbers of samples, each at least 2.", "Write, for example, --n 5,7."
        )
    if not any(isinstance(table, TableOfMeans) for table in publication.tables):
        raise UserError(f"{publication.name} counts successes, and states its trials.", "Leave out --n.")
    return sorted(set(map(int, parts)))


def _methods(text: str | None, publication: Publication) -> Sequence[str]:
    from lfobench.cells.names import split_names
    from lfobench.errors import UserError, unknown_name

    if text is None:
        return ()
    known = {method for table in publication.tables for method in table.methods}
    names = split_names(text)
    if len(names) < 2:
        raise UserError(f"--methods '{text}' names fewer than two methods.", f"Known: {', '.join(sorted(known))}.")
    for name in names:
        if name not in known:
            raise unknown_name("method of this publication", name, known)
    return names
