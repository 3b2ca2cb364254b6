"""The audit of a table of successes in words."""

from __future__ import annotations

from lfobench.render.audit_words import Grid, TableReport, contradiction_notes, listed, methods_text, p_text
from lfobench.render.cell_text import MISSING
from lfobench.render.highlight_note import CORRECTIONS
from lfobench.render.table import Note
from lfobench.stats.audit_counts import AuditedCounts, CountsAudit, CountTest
from lfobench.words import counted

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
        (row.name, methods_text(row.printed), _verdict(row), p_text(row.p), p_text(row.holm), p_text(row.bh))
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


def _verdict(row: AuditedCounts) -> str:
    if row.outcome == "better":
        return f"{methods_text(row.best)} better"
    return "no competitor" if row.outcome == "unopposed" else "undecided"


def _rate(audit: CountsAudit, index: int, method: str) -> str:
    cell, interval = audit.table.rows[index].cells.get(method), audit.rows[index].intervals.get(method)
    if cell is None or interval is None:
        return MISSING
    return f"{cell.successes}/{cell.trials} [{interval.low:.2f}, {interval.high:.2f}]"
