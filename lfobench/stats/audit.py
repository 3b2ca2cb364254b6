"""Audit of a published table: whether its highlights follow from its own numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal, TypeAlias

import numpy as np

from lfobench.records.publication import PrintedCount, PrintedMean, PublishedRow, TableOfCounts, TableOfMeans
from lfobench.stats.contradictions import Contradiction, contradictions_of_highlights, contradictions_of_means, rate
from lfobench.stats.highlight import Outcome, Rule, adjusted, highlights, places
from lfobench.stats.intervals import Interval, Summary
from lfobench.stats.options import Correction
from lfobench.stats.power import seeds_needed_for
from lfobench.stats.successes import boschloo_test, fisher_test, wilson_interval
from lfobench.stats.tests import Sample, p_value

POWER = 0.8
MOST_SEEDS = 1000


@dataclass(frozen=True)
class Effect:
    """Best against second best of one row, as printed, and the samples per method that showing it needs.

    Attributes:
        best: the best method; the first of several.
        second: the second best; of several the one that is hardest to tell apart.
        difference: of their means, in the table's unit.
        needed: samples for 80 % power at the rule's level, by Welch's test; None for more than `MOST_SEEDS`.
        needed_by_holm: the same at the first step of Holm, the level divided by the number of rows.
    """

    best: str
    second: str
    difference: float
    needed: int | None
    needed_by_holm: int | None


def effects(table: TableOfMeans, compared: Sequence[str], alpha: float) -> tuple[Effect | None, ...]:
    """Per row of the table; None where there are not two methods, or a spread is missing."""
    pairs = [_best_and_seconds(row, compared) for row in table.rows]
    tests = sum(bool(seconds) for _, seconds in pairs)
    return tuple(
        max((_effect(row, best, second, alpha, tests) for second in seconds), key=_hardest, default=None)
        for row, (best, seconds) in zip(table.rows, pairs, strict=True)
    )


def _best_and_seconds(row: PublishedRow[PrintedMean], compared: Sequence[str]) -> tuple[str, list[str]]:
    """The best and all that share second place; nobody where a spread is missing."""
    cells = {method: row.cells[method] for method in compared if method in row.cells}
    if len(cells) < 2:
        return "", []
    best = max(cells, key=lambda method: cells[method].mean)
    second = max(cell.mean for method, cell in cells.items() if method != best)
    seconds = [method for method, cell in cells.items() if method != best and cell.mean == second]
    complete = all(cells[method].std is not None for method in (best, *seconds))
    return best, seconds if complete else []


def _effect(row: PublishedRow[PrintedMean], best: str, second: str, alpha: float, tests: int) -> Effect:
    first, other = row.cells[best], row.cells[second]
    assert first.spread is not None and other.spread is not None
    difference = first.mean - other.mean
    needed, by_holm = (
        seeds_needed_for(difference, first.spread, other.spread, POWER, level, MOST_SEEDS)
        for level in (alpha, alpha / tests)
    )
    return Effect(best, second, difference, needed, by_holm)


def _hardest(effect: Effect) -> int:
    return MOST_SEEDS + 1 if effect.needed is None else effect.needed


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
        outcome: of best against second best.
        p: two-sided p-value of best against second best, a spread printed as 0 taken for the largest that prints so;
            None where there was no test.
        p_range: the smallest and the largest p that spreads give which print as these, with the means as printed; None
            likewise.
        decided: whether the rule's level lies outside that range.
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
        """Whether best and second best differ significantly, by `adjusted_p` too."""
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
    """The highlighted methods; None where no cell is marked."""
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


def _p_range_of(rule: Rule, *pair: tuple[PrintedMean, Summary]) -> tuple[float, float]:
    """Over a grid: Welch's p need not grow with a spread, which adds degrees of freedom too."""
    (one, first), (two, second) = pair
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
    """The table without the n that its cells state, for a reader who states one."""
    rows = tuple(
        PublishedRow(row.place, {method: replace(cell, n=None) for method, cell in row.cells.items()})
        for row in table.rows
    )
    return replace(table, rows=rows)


CountTest: TypeAlias = Literal["fisher", "boschloo"]
"""Two-sided exact tests of two success rates."""

_TESTS: dict[CountTest, Callable[[int, int, int, int], float]] = {"fisher": fisher_test, "boschloo": boschloo_test}


@dataclass(frozen=True)
class CountsRule:
    """Rule for success rates: best against second best of a row."""

    test: CountTest = "fisher"
    correction: Correction = "none"
    alpha: float = 0.05


@dataclass(frozen=True)
class AuditedCounts:
    """One row.

    Attributes:
        name: of the row.
        printed: the methods that the table highlights; None where it marks none of them, by 1 or by 0.
        best: the methods with the largest rate.
        intervals: Wilson's 95 % interval per method.
        outcome: of best against second best; methods that are level are undecided.
        p: two-sided p-value of best against second best; None where there is nothing to compare.
        holm: `p` adjusted by Holm over the rows tested.
        bh: `p` adjusted by Benjamini and Hochberg.
    """

    name: str
    printed: frozenset[str] | None
    best: frozenset[str]
    intervals: Mapping[str, Interval]
    outcome: Outcome
    p: float | None
    holm: float | None
    bh: float | None

    @property
    def merely_largest(self) -> bool:
        """Whether the highlighted count is the largest and no more than that."""
        return self.outcome == "undecided" and self.printed == self.best


@dataclass(frozen=True)
class CountsAudit:
    """All findings on a table of successes.

    Attributes:
        table: the table.
        compared: the methods that compete.
        rule: the declared rule.
        rows: in the table's order.
        contradictions: found from the numbers.
    """

    table: TableOfCounts
    compared: tuple[str, ...]
    rule: CountsRule
    rows: tuple[AuditedCounts, ...]
    contradictions: tuple[Contradiction, ...]

    @property
    def closest(self) -> AuditedCounts | None:
        """The row with the smallest p-value; None where no row was tested."""
        return min((row for row in self.rows if row.p is not None), key=lambda row: row.p or 0.0, default=None)


def audit_counts(table: TableOfCounts, compared: Sequence[str], rule: CountsRule) -> CountsAudit:
    """Audits a table of successes; `compared` are the methods that compete.

    Raises:
        ValueError: a count is impossible.
    """
    chosen = [{method: row.cells[method] for method in compared if method in row.cells} for row in table.rows]
    p_values = [_p_value(cells, rule.test) for cells in chosen]
    tested = [p for p in p_values if p is not None]
    corrected, holm, bh = (iter(adjusted(tested, name)) for name in (rule.correction, "holm", "bh"))
    rows = [
        _unopposed(row, cells)
        if p is None
        else _audited(row, cells, "better" if next(corrected) < rule.alpha else "undecided", p, next(holm), next(bh))
        for row, cells, p in zip(table.rows, chosen, p_values, strict=True)
    ]
    return CountsAudit(table, tuple(compared), rule, tuple(rows), tuple(contradictions_of_highlights(table)))


def _p_value(cells: Mapping[str, PrintedCount], test: CountTest) -> float | None:
    """p of the best against the second best, the largest of those that share second place."""
    if len(cells) < 2:
        return None
    best = max(cells, key=lambda method: rate(cells[method]))
    others = [cell for method, cell in cells.items() if method != best]
    second = max(map(rate, others))
    return max(
        _TESTS[test](cells[best].successes, cells[best].trials, cell.successes, cell.trials)
        for cell in others
        if rate(cell) == second
    )


def _unopposed(row: PublishedRow[PrintedCount], cells: Mapping[str, PrintedCount]) -> AuditedCounts:
    return _audited(row, cells, "unopposed", None, None, None)


def _audited(
    row: PublishedRow[PrintedCount],
    cells: Mapping[str, PrintedCount],
    outcome: Outcome,
    p: float | None,
    holm: float | None,
    bh: float | None,
) -> AuditedCounts:
    largest = max(map(rate, cells.values()), default=None)
    return AuditedCounts(
        row.name,
        printed_highlights({method: cell.highlighted for method, cell in cells.items()}),
        frozenset(method for method, cell in cells.items() if rate(cell) == largest),
        {method: wilson_interval(cell.successes, cell.trials) for method, cell in cells.items()},
        outcome,
        p,
        holm,
        bh,
    )
