"""The part of the footnote that says what a highlight means, and what this design could not have shown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lfobench.render.cell_text import LOST
from lfobench.render.table import HIGHLIGHT_NOTE, Note, Row, Table, competes
from lfobench.stats.comparison import PAIRED
from lfobench.stats.contrast import scores_compared
from lfobench.stats.feasibility import can_reach, smallest_p
from lfobench.stats.names import Correction, HighlightTest, Scope

TESTS: dict[HighlightTest, str] = {
    "welch": "Welch's two-sided t-test",
    "student": "Student's two-sided t-test",
    "mann-whitney": "the two-sided Mann-Whitney test",
    "permutation": "the two-sided permutation test of the means",
    "paired-t": "the two-sided paired t-test",
    "wilcoxon": "Wilcoxon's two-sided signed-rank test",
    "paired-permutation": "the two-sided sign-flip test of the mean difference",
    "fisher": "Fisher's exact two-sided test of the pooled counts",
}

CORRECTIONS: dict[Correction, str] = {"none": "none", "holm": "Holm", "bh": "Benjamini-Hochberg"}

SCOPES: dict[Scope, str] = {"group": "the methods without expert actions", "all": "all methods"}


def highlight_notes(table: Table) -> Iterator[Note]:
    """What was compared with what, at which level; which rows decided nothing, and why."""
    rule, rows = table.rule, [row for _, row in table.rows()]
    tested = sum(row.p is not None for row in rows)
    corrected = f" corrected by {CORRECTIONS[rule.correction]} over the {tested} rows tested"
    text = (
        f"the best {'success rate' if table.counts else 'mean'} in its row among {SCOPES[rule.scope]}, "
        "and the second best too unless "
        f"{TESTS[rule.test]} between them gives p < {rule.alpha:g}"
        f"{'' if rule.correction == 'none' else corrected}. "
        f"Correction for multiple comparisons: {CORRECTIONS[rule.correction]}"
    )
    for outcome, said in (
        ("untested", f"Not tested for want of a second {unit(rule.test)}, both highlighted"),
        ("unopposed", "Nothing to compare, nothing highlighted"),
        ("all failed", "No success at all, nothing highlighted"),
    ):
        if concerned := [row for row in rows if row.outcome == outcome]:
            text += f". {said}: {_where(concerned, rows)}"
    if table.counts:
        text += ". Counts are tested because every record says how its episodes ended"
    yield Note(HIGHLIGHT_NOTE, f"{text}.")
    if rule.test in PAIRED:
        yield Note(
            "Pairs",
            "the test pairs the common start states, each with its mean over seeds. It speaks of other starts of these "
            "trained policies, not of other training seeds.",
        )
    if without := [row for row in rows if row.without_spread]:
        yield Note("No spread", without_spread_note(rule.test, _where(without, rows)))
    if any(cell is not None and cell.lost for _, _, cell in table.cells()):
        by = CORRECTIONS["holm" if rule.correction == "none" else rule.correction]
        yield Note(
            LOST, f"stands out with p < {rule.alpha:g}, and no longer when corrected by {by} over {tested} rows."
        )
    yield from _infeasible(table)


def unit(test: HighlightTest) -> str:
    """What a test counts."""
    return "start state" if test in PAIRED else "episode" if test == "fisher" else "seed"


def without_spread_note(test: HighlightTest, where: str) -> str:
    """What a t-test's p is worth where nothing varies."""
    alike = "all start states differ alike" if test in PAIRED else "on neither side do scores vary over seeds"
    return (
        f"{where}: {alike}, so p is a limit, 0 where the means differ and 1 where they do not. It rests on no estimate "
        f"of spread: other {unit(test)}s may well differ."
    )


def _where(concerned: Sequence[Row], rows: Sequence[Row]) -> str:
    return "every row" if len(concerned) == len(rows) else ", ".join(row.task for row in concerned)


def _infeasible(table: Table) -> Iterator[Note]:
    """Said where no result whatever could have been significant: silence would read as "no difference"."""
    rule = table.rule
    tested = [_sizes(table, row) for _, row in table.rows() if row.p is not None]
    if any(can_reach(rule.test, *sizes, rule.alpha, len(tested), rule.correction) for sizes in tested):
        return
    found = [(p, max(sizes)) for sizes in tested if (p := smallest_p(rule.test, *sizes)) is not None]
    if found:
        smallest, most = min(found)
        times = f", times {len(tested)} under Holm" if rule.correction == "holm" and len(tested) > 1 else ""
        yield Note(
            "Design",
            f"with {most} {unit(rule.test)}s, {TESTS[rule.test]} gives at best p = {smallest:.2g}{times}, so no row "
            "could have come out significant. Use more, or another test.",
        )


def _sizes(table: Table, row: Row) -> tuple[int, int]:
    """The two largest samples that the row could have compared."""
    samples = [
        cell.sample
        for column, cell in zip(table.columns, row.cells, strict=True)
        if cell is not None and cell.sample is not None and competes(column, table.rule.scope)
    ]
    sizes = sorted(scores_compared(table.rule.test, sample) for sample in samples)
    return sizes[-1], sizes[-2]
