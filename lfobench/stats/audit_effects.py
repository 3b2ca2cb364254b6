"""How many samples the printed differences of a table would have needed.

The printed difference and spreads are taken for the true ones where seeds are counted; a spread printed as 0 for the
largest that prints so. Such an estimate is itself
uncertain, and too small where a difference was published because it was large: J. M. Hoenig, D. M. Heisey, "The abuse
of power", The American Statistician 55, 2001.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lfobench.contract.publication import PrintedMean, PublishedRow, TableOfMeans
from lfobench.stats.power import seeds_needed_for

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
