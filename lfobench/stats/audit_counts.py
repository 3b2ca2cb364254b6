"""What a published table of successes says about its highlights: most are merely the largest count."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from lfobench.contract.publication import PrintedCount, PublishedRow, TableOfCounts
from lfobench.stats.audit import printed_highlights
from lfobench.stats.contradictions import Contradiction, contradictions_of_highlights, rate
from lfobench.stats.correction import adjusted
from lfobench.stats.highlight import Outcome
from lfobench.stats.intervals import Interval
from lfobench.stats.names import Correction
from lfobench.stats.proportions import boschloo_test, fisher_test, wilson_interval

CountTest: TypeAlias = Literal["fisher", "boschloo"]
"""Two-sided exact tests of two success rates."""

_TESTS: dict[CountTest, Callable[[int, int, int, int], float]] = {"fisher": fisher_test, "boschloo": boschloo_test}


@dataclass(frozen=True)
class CountsRule:
    """How success rates are compared: best against second best of a row."""

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
        outcome: what the rule says of the best against the second best; level ones are never told apart.
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
    """Of the best against the second best, the largest of those that share second place."""
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
