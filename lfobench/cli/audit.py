"""``lfobench audit``: what a published table's own numbers say about its highlights."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from lfobench.cli.console import output

if TYPE_CHECKING:
    from lfobench.records.publication import Publication
    from lfobench.stats.highlight import Rule
    from lfobench.stats.options import Correction


_MOST_TRIALS_OF_BOSCHLOO = 1000


class Format(StrEnum):
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
    format_name: Annotated[Format, typer.Option("--format", help="How to print.")] = Format.terminal,
) -> None:
    """Which highlights of a published table follow from its numbers, which survive a correction, what contradicts.

    Example: lfobench audit dilo-2024
    """
    from lfobench.analyses import audit as rendering
    from lfobench.analyses.audit import Audit, json_audit
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
    if format_name is Format.terminal:
        output.print(rendering.terminal(found))
    else:
        export = rendering.markdown if format_name is Format.markdown else json_audit
        output.out(export(found), end="", highlight=False)


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
