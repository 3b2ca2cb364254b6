"""The characters of a cell: shared by the exporters, so that every format prints the same number."""

from __future__ import annotations

from dataclasses import dataclass

from lfobench.render.table import Cell

PLUS_MINUS = "±"
MISSING = "–"
DIVERGED = "✗"


@dataclass(frozen=True)
class CellText:
    """The parts of one cell, each to one decimal.

    Attributes:
        mean: e.g. ``97.9``.
        std: e.g. ``8.1``; empty for a single seed.
        diverged: number of diverged seeds, e.g. ``1``; empty for none.
    """

    mean: str
    std: str
    diverged: str

    def __str__(self) -> str:
        spread = f" {PLUS_MINUS} {self.std}" if self.std else ""
        mark = f" {DIVERGED}{self.diverged}" if self.diverged else ""
        return f"{self.mean}{spread}{mark}"


def cell_text(cell: Cell) -> CellText:
    """The parts that are printed of `cell`."""
    std = cell.summary.std
    return CellText(
        mean=_one_decimal(cell.summary.mean),
        std="" if std is None else _one_decimal(std),
        diverged=str(len(cell.diverged_seeds) or ""),
    )


def _one_decimal(value: float) -> str:
    # "z" prints -0.04 as 0.0 rather than -0.0.
    return f"{value:z.1f}"
