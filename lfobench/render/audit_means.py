"""The audit of a table of means in words."""

from __future__ import annotations

from collections.abc import Iterator

from lfobench.render.audit_words import Grid, TableReport, contradiction_notes, listed, methods_text, p_text
from lfobench.render.cell_text import MISSING
from lfobench.render.highlight_note import CORRECTIONS, TESTS
from lfobench.render.table import Note
from lfobench.stats.audit import LARGEST_N_TRIED, AuditAtN, AuditedRow, MeansAudit
from lfobench.stats.audit_effects import MOST_SEEDS, POWER, Effect
from lfobench.stats.names import Correction
from lfobench.words import counted

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
