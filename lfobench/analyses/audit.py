"""An audit for a terminal and in Markdown: the verdict first, then the tables."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.text import Text

from lfobench.records.publication import Publication
from lfobench.stats.audit import (
    LARGEST_N_TRIED,
    MOST_SEEDS,
    POWER,
    AuditAtN,
    AuditedCounts,
    AuditedRow,
    CountsAudit,
    CountTest,
    Effect,
    MeansAudit,
)
from lfobench.stats.contradictions import Contradiction
from lfobench.stats.options import Correction
from lfobench.tables.exporters.markdown import escape
from lfobench.tables.exporters.terminal import Section, aligned, wrapped
from lfobench.tables.footnote import CORRECTIONS, TESTS
from lfobench.tables.table import MISSING, Note
from lfobench.text import counted


@dataclass(frozen=True)
class Grid:
    """Rows of text: `columns` names the cells, the first of a row being what it is about."""

    heading: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class TableReport:
    """One table: what follows, the rows, and what a reader must know to judge them."""

    title: str
    summary: tuple[str, ...]
    grids: tuple[Grid, ...]
    notes: tuple[Note, ...]


def contradiction_notes(contradictions: Sequence[Contradiction]) -> Iterator[Note]:
    """One note for each of what was found in the numbers."""
    for found in contradictions:
        yield Note("Contradiction", f"{f'{found.where}: ' if found.where else ''}{found.text}.")


def p_text(p: float | None) -> str:
    """A p-value to four decimals; a dash where there was no test."""
    if p is None:
        return MISSING
    return "<0.0001" if p < 0.0001 else f"{p:.4f}"


def methods_text(methods: frozenset[str] | None) -> str:
    """Names in the order of the alphabet; a dash for none."""
    return ", ".join(sorted(methods)) if methods else MISSING


def listed(before: str, names: Sequence[str]) -> str:
    """``before`` and the names; nothing where there is no name."""
    return f"{before} {', '.join(names)}" if names else ""


_NEEDED = "needs n"
_NO_N = "nothing was tested, because n is not stated (say it with --n)"


def means_in_short(audit: MeansAudit) -> str:
    """What follows, without the table's name: the part of the verdict."""
    if not audit.by_n:
        said = _reproducing(audit)
        return f"{_NO_N}{f'; {said}' if said else ''}."
    sentences = []
    for at_n in audit.by_n:
        judged, winners = at_n.judged, at_n.winners
        follow = sum(bool(row.follows) for row in judged)
        says = f"{follow} of {len(judged)} printed highlights follow" if judged else "no printed highlight to judge"
        left = len(winners) - len(at_n.lost("holm"))
        single = counted(len(winners), "single winner", "single winners")
        open_rows = len(at_n.undecided_by_print)
        blurred = f", {open_rows} not decided by the printed numbers" if open_rows else ""
        sentences.append(f"with {_n(at_n)}, {says}{blurred}, and Holm leaves {left} of {single}")
    return f"{'; '.join(sentences)}."


def report_means(audit: MeansAudit) -> TableReport:
    """Everything, with a grid of rows per number of samples."""
    summary = [
        f"Rule: {TESTS[audit.rule.test]} of best against second best in a row, among {', '.join(audit.compared)}; the "
        f"best alone is highlighted if p < {audit.rule.alpha:g}, both otherwise. "
        f"Correction for multiple comparisons: {CORRECTIONS[audit.rule.correction]}.",
        *(_follows(audit, at_n) for at_n in audit.by_n),
    ]
    if not audit.by_n:
        summary.append(f"{_NO_N[0].upper()}{_NO_N[1:]}.")
    if said := _reproducing(audit):
        summary.append(f"{said[0].upper()}{said[1:]}.")
    grids = tuple(_at_n(audit, at_n) for at_n in audit.by_n) or (_without_n(audit),)
    return TableReport(audit.table.title, tuple(summary), grids, tuple(_means_notes(audit)))


def _follows(audit: MeansAudit, at_n: AuditAtN) -> str:
    where = " and ".join(claim.where for claim in audit.table.claims if claim.n == at_n.n)
    judged, winners = at_n.judged, at_n.winners
    text = f"With {_n(at_n)}{f' ({where})' if where else ''}: "
    if open_rows := at_n.undecided_by_print:
        text += f"{counted(len(open_rows), 'row is', 'rows are')} not decided by the printed numbers"
        text += f"{listed(':', [row.name for row in open_rows])}. "
    if judged:
        text += f"{len([row for row in judged if row.follows])} of {len(judged)} printed highlights follow"
        against = [
            f"{row.name} ({methods_text(row.printed)} printed, {methods_text(row.ruled)} by the rule)" for row in judged
        ]
        text += listed("; not", [line for line, row in zip(against, judged, strict=True) if not row.follows])
        text += ". "
    text += f"{counted(len(winners), 'row has', 'rows have')} a single winner before any correction"
    corrections: tuple[Correction, ...] = ("holm", "bh")
    for correction in corrections:
        lost = at_n.lost(correction)
        text += f"; {CORRECTIONS[correction]} over {len(at_n.tested)} rows leaves {len(winners) - len(lost)}"
        text += listed(", without", [row.name for row in lost])
    return f"{text}."


def _reproducing(audit: MeansAudit) -> str:
    tried = f"n from 2 to {LARGEST_N_TRIED}"
    n = audit.reproducing
    if n:
        ranged = (
            f"n = {n[0]} to {n[-1]}" if len(n) > 2 and n[-1] - n[0] == len(n) - 1 else f"n = {', '.join(map(str, n))}"
        )
        return f"the rule gives every printed highlight for {ranged}, of {tried}"
    if any(at_n.n is None for at_n in audit.by_n) or not _any_printed(audit):
        return ""
    return f"the rule gives every printed highlight for no {tried}"


def _any_printed(audit: MeansAudit) -> bool:
    return any(row.cells[method].highlighted is not None for row in audit.table.rows for method in row.cells)


def _at_n(audit: MeansAudit, at_n: AuditAtN) -> Grid:
    columns = ("highlighted", "verdict", "p", "Holm", "BH", _NEEDED)
    rows = [
        (
            row.name,
            methods_text(row.printed),
            _verdict(audit, at_n, row),
            _p(row),
            p_text(row.holm),
            p_text(row.bh),
            _needed(effect),
        )
        for row, effect in zip(at_n.rows, audit.effects, strict=True)
    ]
    return Grid(f"{audit.table.title}, {_n(at_n)}", columns, tuple(rows))


def _p(row: AuditedRow) -> str:
    """With what unprinted digits leave open, where that is what decides."""
    if row.p_range is None or row.decided:
        return p_text(row.p)
    low, high = map(p_text, row.p_range)
    return f"{low} to {high}"


def _without_n(audit: MeansAudit) -> Grid:
    rows = [
        (row.name, methods_text(_marked(audit, index)), effect.best if effect else MISSING, _needed(effect))
        for index, (row, effect) in enumerate(zip(audit.table.rows, audit.effects, strict=True))
    ]
    return Grid(f"{audit.table.title}, n not stated", ("highlighted", "best", _NEEDED), tuple(rows))


def _marked(audit: MeansAudit, index: int) -> frozenset[str]:
    cells = audit.table.rows[index].cells
    return frozenset(method for method in audit.compared if method in cells and cells[method].highlighted)


def _verdict(audit: MeansAudit, at_n: AuditAtN, row: AuditedRow) -> str:
    against = "does not follow: " if row.follows is False else ""
    return f"{against}{_outcome(audit, at_n, row)}"


def _outcome(audit: MeansAudit, at_n: AuditAtN, row: AuditedRow) -> str:
    if row.outcome == "untested":
        return "not tested"
    if row.outcome == "unopposed":
        return "no competitor"
    if not row.decided:
        return "not decided by the printed numbers"
    if row.outcome == "better":
        lost = audit.rule.correction != "holm" and row in at_n.lost("holm")
        # Where the highlight follows, it names the winner beside the verdict.
        named = "" if row.follows else f"{methods_text(row.ruled)} "
        return f"{named}better{', Holm undecided' if lost else ''}"
    return f"undecided{', better uncorrected' if row in at_n.winners else ''}"


def _means_notes(audit: MeansAudit) -> Iterator[Note]:
    yield from contradiction_notes(audit.contradictions)
    yield Note(
        _NEEDED.capitalize(),
        f"samples of each of the two for power {POWER:g} by Welch's test at {audit.rule.alpha:g}; in brackets, at the "
        "first step of Holm, the level over the number of rows. It takes the printed difference and spreads for the "
        "true ones, which favours differences that were printed because they were large.",
    )
    for at_n in audit.by_n:
        for row, effect in zip(at_n.rows, audit.effects, strict=True):
            if row.p_range is None or row.decided or effect is None:
                continue
            yield Note(
                "Not decided",
                f"{row.name}, {_n(at_n)}: {_spreads(audit, row, effect)}, p up to {row.p_range[1]:.2g} and down to "
                f"{row.p_range[0]:.2g}: not decided by the printed numbers.",
            )
    if audit.by_n:
        yield Note("Holm, BH", "p corrected over the rows tested, by Holm and by Benjamini and Hochberg.")
    yield Note(
        "Spread",
        "what the table prints after ± is read as the sample standard deviation, rounded to the digits printed; ± 0 as "
        "the largest that prints so. A verdict holds for every spread that prints alike, with the means as printed.",
    )


def _spreads(audit: MeansAudit, row: AuditedRow, effect: Effect) -> str:
    """``± 0 may be up to ± 0.5``, of the two methods that were compared."""
    cells = next(each for each in audit.table.rows if each.name == row.name).cells
    texts = dict.fromkeys(
        f"± {cell.std:g} may be up to ± {cell.spreads[1]:g}"
        for method in (effect.best, effect.second)
        if (cell := cells[method]).spreads is not None
    )
    return ", ".join(texts)


def _n(at_n: AuditAtN) -> str:
    return "n as each cell states" if at_n.n is None else f"n = {at_n.n}"


def _needed(effect: Effect | None) -> str:
    if effect is None:
        return MISSING
    if effect.needed is None:
        return f">{MOST_SEEDS}"
    return f"{effect.needed} ({effect.needed_by_holm or f'>{MOST_SEEDS}'})"


COUNT_TESTS: dict[CountTest, str] = {
    "fisher": "Fisher's exact test",
    "boschloo": "Boschloo's exact test",
}


def counts_in_short(audit: CountsAudit) -> str:
    """What follows, without the table's name: the part of the verdict."""
    better = [row for row in audit.rows if row.outcome == "better"]
    closest, test = audit.closest, COUNT_TESTS[audit.rule.test]
    if closest is None:
        return "no row has two methods to compare."
    names = listed(":", [row.name for row in better])
    text = (
        f"{counted(len(better), 'row has', 'rows have') if better else 'no row has'} a better method by {test}{names}"
    )
    text += f" (smallest p {p_text(closest.p)}, {closest.name})"
    highlighted = [row for row in audit.rows if row.printed]
    merely = [row for row in highlighted if row.merely_largest]
    return f"{text}; {len(merely)} of {len(highlighted)} highlighted rows mark merely the largest count."


def report_counts(audit: CountsAudit) -> TableReport:
    """Everything, in one grid of rows."""
    rule = audit.rule
    short = counts_in_short(audit)
    summary = (
        f"Rule: {COUNT_TESTS[rule.test]}, two-sided, of best against second best in a row, among "
        f"{', '.join(audit.compared)}; better if p < {rule.alpha:g}. "
        f"Correction for multiple comparisons: {CORRECTIONS[rule.correction]}.",
        f"{short[0].upper()}{short[1:]}",
    )
    verdicts = tuple(
        (row.name, methods_text(row.printed), _counts_verdict(row), p_text(row.p), p_text(row.holm), p_text(row.bh))
        for row in audit.rows
    )
    rates = tuple(
        (row.name, *(_rate(audit, index, method) for method in audit.compared)) for index, row in enumerate(audit.rows)
    )
    grids = (
        Grid(audit.table.title, ("highlighted", "verdict", "p", "Holm", "BH"), verdicts),
        Grid(f"{audit.table.title}, successes", audit.compared, rates),
    )
    notes = (
        *contradiction_notes(audit.contradictions),
        Note("Brackets", "Wilson's 95% interval of the success rate."),
        Note("Trials", "taken as independent; trials of one trained policy share its seed, and then p is too small."),
    )
    return TableReport(audit.table.title, summary, grids, notes)


def _counts_verdict(row: AuditedCounts) -> str:
    if row.outcome == "better":
        return f"{methods_text(row.best)} better"
    return "no competitor" if row.outcome == "unopposed" else "undecided"


def _rate(audit: CountsAudit, index: int, method: str) -> str:
    cell, interval = audit.table.rows[index].cells.get(method), audit.rows[index].intervals.get(method)
    if cell is None or interval is None:
        return MISSING
    return f"{cell.successes}/{cell.trials} [{interval.low:.2f}, {interval.high:.2f}]"


@dataclass(frozen=True)
class Audit:
    """What is rendered.

    Attributes:
        publication: what was audited.
        tables: one audit per table.
    """

    publication: Publication
    tables: tuple[MeansAudit | CountsAudit, ...]


def verdict(audit: Audit) -> str:
    """One paragraph: what follows from the numbers and what does not."""
    parts = [
        f"{table.table.title}: {means_in_short(table) if isinstance(table, MeansAudit) else counts_in_short(table)}"
        for table in audit.tables
    ]
    computed = sum(len(table.contradictions) for table in audit.tables)
    stated = len(audit.publication.contradictions)
    found = f"Contradictions: {computed} in the numbers"
    return " ".join([*parts, f"{found}, {stated} in the text as its transcriber states." if stated else f"{found}."])


def table_reports(audit: Audit) -> list[TableReport]:
    """Every table of the audit."""
    return [report_means(table) if isinstance(table, MeansAudit) else report_counts(table) for table in audit.tables]


def stated_contradictions(audit: Audit) -> list[str]:
    """What only the paper's prose shows; not computed."""
    return [f"{stated.about}: {stated.first}; {stated.second}." for stated in audit.publication.contradictions]


_STATED = "Stated by the transcriber, not computed"


def terminal(audit: Audit) -> RenderableType:
    """What ``Console.print`` draws an audit from."""
    return _Terminal(audit)


def markdown(audit: Audit) -> str:
    """The audit in GitHub-flavoured Markdown."""
    publication = audit.publication
    lines = [f"# Audit of {escape(publication.name)}", ""]
    if publication.paper:
        lines += [f"{escape(publication.paper)}.", ""]
    lines += [escape(verdict(audit)), ""]
    for report in table_reports(audit):
        lines += _markdown_table(report)
    if stated := stated_contradictions(audit):
        lines += [f"## {_STATED}", "", *(f"- {escape(text)}" for text in stated), ""]
    return "\n".join(lines)


class _Terminal:
    def __init__(self, audit: Audit) -> None:
        self.audit = audit

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        audit, width = self.audit, options.max_width
        if audit.publication.paper:
            yield Text(audit.publication.paper, "dim")
            yield Text()
        yield from _paragraph(verdict(audit), width, "bold")
        for report in table_reports(audit):
            yield Text()
            yield Text(report.title, "bold")
            for sentence in report.summary:
                yield from _paragraph(sentence, width)
            for grid in report.grids:
                yield Text()
                yield from aligned(grid.columns, [Section(grid.heading, "italic", grid.rows)], width)
            yield Text()
            yield from wrapped(report.notes, width)
        if stated := stated_contradictions(audit):
            yield Text()
            yield Text(_STATED, "bold")
            yield from wrapped([Note("-", text) for text in stated], width)


def _paragraph(text: str, width: int, style: str = "") -> Iterator[Text]:
    # A task's name is easier to read and to search for in one piece.
    for line in wrap(text, width, break_on_hyphens=False):
        yield Text(line, style)


def _markdown_table(report: TableReport) -> Iterator[str]:
    yield from (f"## {escape(report.title)}", "")
    for sentence in report.summary:
        yield from (escape(sentence), "")
    for grid in report.grids:
        yield from _markdown_grid(grid)
    yield from (f"- **{escape(note.label)}**: {escape(note.text)}" for note in report.notes)
    yield ""


def _markdown_grid(grid: Grid) -> Iterator[str]:
    yield _line((grid.heading, *grid.columns))
    yield _line((":--", *("--:" for _ in grid.columns)), escaped=False)
    yield from (_line(row) for row in grid.rows)
    yield ""


def _line(fields: tuple[str, ...], escaped: bool = True) -> str:
    return f"| {' | '.join(escape(field) if escaped else field for field in fields)} |"


def json_audit(audit: Audit) -> str:
    """One object: the verdict, a finding per table, the contradictions of the text.

    Numbers of samples are null where more than ``most_samples`` would be needed.
    """
    publication = audit.publication
    value = {
        "publication": publication.name,
        "paper": publication.paper,
        "verdict": verdict(audit),
        "power": POWER,
        "most_samples": MOST_SEEDS,
        "tables": [_means(table) if isinstance(table, MeansAudit) else _counts(table) for table in audit.tables],
        "stated_contradictions": [
            {"about": stated.about, "first": stated.first, "second": stated.second}
            for stated in publication.contradictions
        ],
    }
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def _means(audit: MeansAudit) -> dict[str, Any]:
    rule = audit.rule
    return {
        "table": audit.table.title,
        "kind": "means",
        "rule": {"test": rule.test, "correction": rule.correction, "alpha": rule.alpha},
        "compared": list(audit.compared),
        "claims_of_n": [{"n": claim.n, "where": claim.where} for claim in audit.table.claims],
        "n_that_give_every_highlight": list(audit.reproducing),
        "by_n": [_at_n_as_json(at_n) for at_n in audit.by_n],
        "effects": [
            {"row": row.name, **_effect(effect)} for row, effect in zip(audit.table.rows, audit.effects, strict=True)
        ],
        "contradictions": _contradictions(audit.contradictions),
    }


def _at_n_as_json(at_n: AuditAtN) -> dict[str, Any]:
    return {
        "n": at_n.n,
        "printed_highlights": len(at_n.judged),
        "follow": sum(bool(row.follows) for row in at_n.judged),
        "rows_tested": len(at_n.tested),
        "single_winners": len(at_n.winners),
        "lost_by_holm": [row.name for row in at_n.lost("holm")],
        "lost_by_bh": [row.name for row in at_n.lost("bh")],
        "not_decided_by_the_printed_numbers": [row.name for row in at_n.undecided_by_print],
        "rows": [
            {**_row(row), "p_range": row.p_range, "follows": row.follows, "by_the_rule": sorted(row.ruled)}
            for row in at_n.rows
        ],
    }


def _effect(effect: Effect | None) -> dict[str, Any]:
    if effect is None:
        return {"best": None, "second": None, "difference": None, "n_needed": None, "n_needed_by_holm": None}
    return {
        "best": effect.best,
        "second": effect.second,
        "difference": effect.difference,
        "n_needed": effect.needed,
        "n_needed_by_holm": effect.needed_by_holm,
    }


def _counts(audit: CountsAudit) -> dict[str, Any]:
    rule = audit.rule
    return {
        "table": audit.table.title,
        "kind": "counts",
        "rule": {"test": rule.test, "correction": rule.correction, "alpha": rule.alpha},
        "compared": list(audit.compared),
        "smallest_p": audit.closest.p if audit.closest else None,
        "merely_the_largest_count": [row.name for row in audit.rows if row.merely_largest],
        "rows": [
            {
                **_row(row),
                "best": sorted(row.best),
                "wilson_95": {method: [interval.low, interval.high] for method, interval in row.intervals.items()},
            }
            for row in audit.rows
        ],
        "contradictions": _contradictions(audit.contradictions),
    }


def _row(row: AuditedRow | AuditedCounts) -> dict[str, Any]:
    return {
        "row": row.name,
        "printed": None if row.printed is None else sorted(row.printed),
        "outcome": row.outcome,
        "p": row.p,
        "holm": row.holm,
        "bh": row.bh,
    }


def _contradictions(found: tuple[Contradiction, ...]) -> list[dict[str, str]]:
    return [{"where": each.where, "text": each.text} for each in found]
