"""What a published table's own numbers say about its highlights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from lfobench.contract.publication import PrintedMean, PublishedRow, TableOfMeans
from lfobench.stats.audit_effects import Effect, effects
from lfobench.stats.comparison import p_value
from lfobench.stats.contradictions import Contradiction, contradictions_of_highlights, contradictions_of_means
from lfobench.stats.correction import adjusted
from lfobench.stats.highlight import Outcome, Rule, highlights, places
from lfobench.stats.names import Correction
from lfobench.stats.sample import Sample
from lfobench.stats.summary import Summary

LARGEST_N_TRIED = 30

_SPREADS_TRIED = 5
"""Between the smallest and the largest spread that print alike."""


@dataclass(frozen=True)
class AuditedRow:
    """One row under the rule, for one number of samples.

    Attributes:
        name: of the row.
        printed: the methods that the table highlights; None where it marks none of them, by 1 or by 0.
        ruled: the methods that the rule highlights.
        outcome: what the rule says of best against second best.
        p: two-sided p-value of best against second best, a spread printed as 0 taken for the largest that prints so;
            None where there was no test.
        p_range: the smallest and the largest p that spreads give which print as these, with the means as printed; None
            likewise.
        decided: whether all of those are on one side of the rule's level.
        holm: `p` adjusted by Holm over the rows tested.
        bh: `p` adjusted by Benjamini and Hochberg.
    """

    name: str
    printed: frozenset[str] | None
    ruled: frozenset[str]
    outcome: Outcome
    p: float | None
    p_range: tuple[float, float] | None
    decided: bool
    holm: float | None
    bh: float | None

    @property
    def follows(self) -> bool | None:
        """Whether the printed highlight is the rule's; None where none is printed or the numbers do not decide."""
        return None if self.printed is None or not self.decided else self.printed == self.ruled

    def adjusted(self, correction: Correction) -> float | None:
        """`p` under a correction."""
        return {"none": self.p, "holm": self.holm, "bh": self.bh}[correction]

    def survives(self, adjusted_p: float | None, alpha: float) -> bool:
        """Whether best and second best are told apart, and still are by `adjusted_p`."""
        return self.decided and self.p is not None and adjusted_p is not None and max(self.p, adjusted_p) < alpha


@dataclass(frozen=True)
class AuditAtN:
    """A table under the rule, its numbers taken as those of `n` samples.

    Attributes:
        n: samples behind every number; None where each cell states its own.
        rows: in the table's order.
        alpha: the rule's level.
    """

    n: int | None
    rows: tuple[AuditedRow, ...]
    alpha: float

    @property
    def judged(self) -> list[AuditedRow]:
        """Rows with a printed highlight and a test."""
        return [row for row in self.rows if row.follows is not None]

    @property
    def tested(self) -> list[AuditedRow]:
        """Rows with a test."""
        return [row for row in self.rows if row.p is not None]

    @property
    def undecided_by_print(self) -> list[AuditedRow]:
        """Rows with a test whose outcome depends on digits that are not printed."""
        return [row for row in self.tested if not row.decided]

    @property
    def winners(self) -> list[AuditedRow]:
        """Rows whose best stands out before any correction."""
        return [row for row in self.tested if row.survives(row.p, self.alpha)]

    def lost(self, correction: Correction) -> list[AuditedRow]:
        """The winners that a correction takes away."""
        return [row for row in self.winners if not row.survives(row.adjusted(correction), self.alpha)]


@dataclass(frozen=True)
class MeansAudit:
    """All findings on a table of means.

    Attributes:
        table: the table.
        compared: the methods among which the rule picks.
        rule: the declared rule.
        by_n: one audit per number of samples; empty where none is known.
        effects: per row; None where there are not two methods with a spread.
        reproducing: the n from 2 to `LARGEST_N_TRIED` at which the rule gives every printed highlight.
        contradictions: found from the numbers.
    """

    table: TableOfMeans
    compared: tuple[str, ...]
    rule: Rule
    by_n: tuple[AuditAtN, ...]
    effects: tuple[Effect | None, ...]
    reproducing: tuple[int, ...]
    contradictions: tuple[Contradiction, ...]


def audit_means(table: TableOfMeans, compared: Sequence[str], rule: Rule, n_values: Sequence[int] = ()) -> MeansAudit:
    """Audits a table of means under `rule`, whose test must need no more than summaries.

    `compared` are the methods that compete. `n_values` replaces what the table states of n; without it, cells that
    state their own n are taken at their word, else every claim of the paper gets its audit.

    Raises:
        ValueError: the rule's test needs scores, or an n is below 2.
    """
    if any(n < 2 for n in n_values):
        raise ValueError(f"A test needs at least two samples; got {list(n_values)}.")
    own_n = not n_values and any(cell.n is not None for row in table.rows for cell in row.cells.values())
    sizes = list(n_values) or sorted({claim.n for claim in table.claims})
    at_n = [_at_n(table, compared, rule, n) for n in ([None] if own_n else sizes)]
    return MeansAudit(
        table,
        tuple(compared),
        rule,
        tuple(at_n),
        effects(table, compared, rule.alpha),
        () if own_n else _reproducing(table, compared, rule),
        (
            *contradictions_of_means(_at_their_word(table) if n_values else table, [] if own_n else sizes),
            *contradictions_of_highlights(table),
        ),
    )


def printed_highlights(cells: Mapping[str, bool | None]) -> frozenset[str] | None:
    """The highlighted methods; None where nothing is said of any."""
    if all(highlighted is None for highlighted in cells.values()):
        return None
    return frozenset(method for method, highlighted in cells.items() if highlighted)


def _at_n(table: TableOfMeans, compared: Sequence[str], rule: Rule, n: int | None) -> AuditAtN:
    samples = [_samples(row, compared, n) for row in table.rows]
    found = highlights(samples, rule)
    ranges = [
        None if highlight.p is None else _p_range(row, of_row, rule)
        for row, of_row, highlight in zip(table.rows, samples, found, strict=True)
    ]
    tested = [highlight.p for highlight in found if highlight.p is not None]
    holm, bh = iter(adjusted(tested, "holm")), iter(adjusted(tested, "bh"))
    rows = [
        AuditedRow(
            row.name,
            _printed(row, compared),
            highlight.methods,
            highlight.outcome,
            highlight.p,
            p_range,
            p_range is not None and not p_range[0] < rule.alpha <= p_range[1],
            None if highlight.p is None else next(holm),
            None if highlight.p is None else next(bh),
        )
        for row, highlight, p_range in zip(table.rows, found, ranges, strict=True)
    ]
    return AuditAtN(n, tuple(rows), rule.alpha)


def _p_range(row: PublishedRow[PrintedMean], samples: Mapping[str, Sample], rule: Rule) -> tuple[float, float]:
    """The smallest and the largest p of best against second best, the largest of those that share second place."""
    best, *others = places(samples, rule.test)
    pairs = list(combinations(best, 2)) or [(best[0], second) for second in others[0]]
    ranges = [_p_range_of(rule, *((row.cells[method], samples[method].summary) for method in pair)) for pair in pairs]
    return max(low for low, _ in ranges), max(high for _, high in ranges)


def _p_range_of(rule: Rule, *sides: tuple[PrintedMean, Summary]) -> tuple[float, float]:
    """Over a grid: Welch's p need not grow with a spread, which adds degrees of freedom too."""
    (one, first), (two, second) = sides
    assert one.spreads is not None and two.spreads is not None
    found = [
        p
        for std_first in np.linspace(*one.spreads, _SPREADS_TRIED)
        for std_second in np.linspace(*two.spreads, _SPREADS_TRIED)
        if (p := p_value(rule.test, _with(first, std_first), _with(second, std_second))) is not None
    ]
    return min(found), max(found)


def _with(summary: Summary, std: float) -> Sample:
    return Sample(replace(summary, std=float(std)))


def _samples(row: PublishedRow[PrintedMean], compared: Sequence[str], n: int | None) -> dict[str, Sample]:
    return {
        method: Sample(_summary(row.cells[method], n if n is not None else row.cells[method].n))
        for method in compared
        if method in row.cells
    }


def _summary(cell: PrintedMean, n: int | None) -> Summary:
    # A single sample, or a number of unknown size, has no spread that a test could use.
    return Summary(n or 1, cell.mean, cell.spread if n is not None and n > 1 else None)


def _printed(row: PublishedRow[PrintedMean], compared: Sequence[str]) -> frozenset[str] | None:
    return printed_highlights({method: row.cells[method].highlighted for method in compared if method in row.cells})


def _reproducing(table: TableOfMeans, compared: Sequence[str], rule: Rule) -> tuple[int, ...]:
    """By the printed numbers themselves, whether or not others that print alike would decide otherwise."""
    printed = [_printed(row, compared) for row in table.rows]
    reproducing = []
    for n in range(2, LARGEST_N_TRIED + 1):
        found = highlights([_samples(row, compared, n) for row in table.rows], rule)
        judged = [
            marked == highlight.methods
            for marked, highlight in zip(printed, found, strict=True)
            if marked is not None and highlight.p is not None
        ]
        if judged and all(judged):
            reproducing.append(n)
    return tuple(reproducing)


def _at_their_word(table: TableOfMeans) -> TableOfMeans:
    """The table without what its cells say of n, for a reader who says it."""
    rows = tuple(
        PublishedRow(row.place, {method: replace(cell, n=None) for method, cell in row.cells.items()})
        for row in table.rows
    )
    return replace(table, rows=rows)
