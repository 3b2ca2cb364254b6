"""Contradictions of a published table, found from its numbers alone.

Reference for means that no sample of the stated size can have: N. J. L. Brown, J. A. J. Heathers, "The GRIM test: a
simple technique detects numerous anomalies in the reporting of results in psychology", Social Psychological and
Personality Science 8, 2017.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lfobench.records.publication import (
    PrintedCell,
    PrintedCount,
    PrintedMean,
    PublishedRow,
    PublishedTable,
    ScoreScale,
    TableOfMeans,
)

_LARGEST_N_NAMED = 10


@dataclass(frozen=True)
class Contradiction:
    """One finding.

    Attributes:
        where: the row; empty where the whole table is concerned.
        text: what cannot both be true, without its full stop.
    """

    where: str
    text: str


def contradictions_of_highlights(table: PublishedTable[PrintedCell]) -> list[Contradiction]:
    """Highlights that no rule of best and second best gives, whatever its test, among the methods compared."""
    compared = table.compared or table.methods
    return [
        Contradiction(row.name, text)
        for row in table.rows
        for text in _highlights({method: row.cells[method] for method in compared if method in row.cells})
    ]


def contradictions_of_means(table: TableOfMeans, n_values: Sequence[int]) -> list[Contradiction]:
    """Stated numbers of samples that differ, and numbers that samples of that size cannot have.

    `n_values` are the sizes to check the numbers against; a cell that states its own is checked against that.
    """
    found = []
    if len({claim.n for claim in table.claims}) > 1:
        stated = " and ".join(f"{claim.n} by {claim.where}" for claim in table.claims)
        found.append(Contradiction("", f"n is {stated}"))
    for row in table.rows:
        found += [Contradiction(row.name, text) for text in _spreads(row, table.scales, n_values)]
    for scale in table.scales:
        found += _impossible_means(table, scale, n_values)
    return found


def rate(cell: PrintedMean | PrintedCount) -> float:
    """Quantity that a highlight ranks by: the mean, or the success rate."""
    return cell.mean if isinstance(cell, PrintedMean) else cell.successes / cell.trials


def _highlights(cells: dict[str, PrintedCell]) -> Iterator[str]:
    highlighted = [method for method, cell in cells.items() if cell.highlighted]
    if not highlighted:
        return
    if len(cells) < 2:
        yield f"{highlighted[0]} is highlighted without a competitor"
        return
    # Cells marked neither 1 nor 0 take no part.
    cells = {method: cell for method, cell in cells.items() if cell.highlighted is not None}
    places = sorted({rate(cell) for cell in cells.values()}, reverse=True)
    best = [method for method, cell in cells.items() if rate(cell) == places[0]]
    for method in highlighted:
        if rate(cells[method]) not in places[:2]:
            yield f"{method} is highlighted and is neither best nor second best"
    if not set(best) & set(highlighted):
        yield f"{', '.join(highlighted)} is highlighted and the best, {', '.join(best)}, is not"
    for method, cell in cells.items():
        for other in highlighted:
            if not cell.highlighted and _same(cell, cells[other]):
                yield f"{other} is highlighted and {method}, with the same numbers, is not"


def _same(one: PrintedMean | PrintedCount, other: PrintedMean | PrintedCount) -> bool:
    if isinstance(one, PrintedMean) and isinstance(other, PrintedMean):
        return (one.mean, one.std, one.n) == (other.mean, other.std, other.n)
    return one == other or rate(one) == rate(other)


def _spreads(row: PublishedRow[PrintedMean], scales: Sequence[ScoreScale], n_values: Sequence[int]) -> Iterator[str]:
    for method, cell in row.cells.items():
        if cell.std is None or cell.spreads is None:
            continue
        if cell.n == 1:
            yield f"{method} has a spread, {cell.std:g}, and one sample, which has none"
            continue
        sizes = [cell.n] if cell.n is not None else [n for n in n_values if n > 1]
        for scale in scales:
            if not scale.holds_for(row.place):
                continue
            # Two samples spread most; no size allows more than that.
            largest = _largest_std(cell, scale, min(sizes, default=2))
            if cell.spreads[0] > largest:
                yield (
                    f"{method} prints {cell.mean:g} ± {cell.std:g}, and scores from {scale.low:g} to {scale.high:g} "
                    f"with that mean have a standard deviation of at most {largest:.3g}"
                )


def _largest_std(cell: PrintedMean, scale: ScoreScale, n: int) -> float:
    """Bhatia and Davis's bound √((mean − low)(high − mean)), as a sample standard deviation, before rounding."""
    low, high = _before_rounding(cell)
    middle = min(max((scale.low + scale.high) / 2.0, low), high)
    return math.sqrt(n / (n - 1) * max(0.0, (middle - scale.low) * (scale.high - middle)))


def _impossible_means(table: TableOfMeans, scale: ScoreScale, n_values: Sequence[int]) -> Iterator[Contradiction]:
    """Means that do not lie on the grid that `n` samples of so many episodes leave."""
    if scale.step is None or scale.episodes is None:
        return
    for n in n_values:
        impossible = [
            f"{row.name} {method} {cell.mean:g}{_sizes_that_fit(cell, scale)}"
            for row in table.rows
            if scale.holds_for(row.place)
            for method, cell in row.cells.items()
            # A number without a spread is a reference, not a mean over samples.
            if cell.std is not None and cell.n is None and not _on_grid(cell, scale, n)
        ]
        if impossible:
            yield Contradiction(
                "",
                f"no {n} samples, each the mean of {scale.episodes} episodes that score in steps of {scale.step:g}, "
                f"have the mean printed: {', '.join(impossible)}",
            )


def _sizes_that_fit(cell: PrintedMean, scale: ScoreScale) -> str:
    sizes = [str(n) for n in range(2, _LARGEST_N_NAMED + 1) if _on_grid(cell, scale, n)]
    return f" (fits n = {', '.join(sizes)})" if sizes else f" (fits no n from 2 to {_LARGEST_N_NAMED})"


def _on_grid(cell: PrintedMean, scale: ScoreScale, n: int) -> bool:
    assert scale.step is not None and scale.episodes is not None
    grid = scale.step / (n * scale.episodes)
    low, high = _before_rounding(cell)
    # Sums of decimals are off by rounding errors far below a printed digit.
    slack = 1e-9 * max(1.0, abs(cell.mean) / grid)
    return math.floor((high - scale.low) / grid + slack) >= math.ceil((low - scale.low) / grid - slack)


def _before_rounding(cell: PrintedMean) -> tuple[float, float]:
    """The means that print as this one, whether digits were rounded or cut off."""
    cut = math.copysign(cell.mean_digit, cell.mean) if cell.mean else 0.0
    return (
        min(cell.mean - cell.mean_digit / 2.0, cell.mean + cut),
        max(cell.mean + cell.mean_digit / 2.0, cell.mean + cut),
    )
