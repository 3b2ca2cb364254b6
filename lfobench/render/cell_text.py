"""The characters of a cell: shared by the exporters, so that every format prints the same number."""

from __future__ import annotations

from dataclasses import dataclass

from lfobench.render.table import Cell
from lfobench.stats.names import Agreement

PLUS_MINUS = "±"
MISSING = "–"
DIVERGED = "✗"
FAILED = "!"
LOST = "†"
AGREEMENTS: dict[Agreement, str] = {"matches": "≈", "differs": "≠", "undecided": "?"}


@dataclass(frozen=True)
class CellText:
    """The parts of one cell, numbers to one decimal.

    Attributes:
        mean: e.g. ``97.9``; a dash where every seed failed.
        std: e.g. ``8.1``; empty for a single seed.
        lost: a dagger where the highlight does not survive a correction, else empty.
        diverged: number of diverged seeds, e.g. ``1``; empty for none.
        failed: number of failed seeds; empty for none.
        agreement: sign of a published number against ours; empty elsewhere.
    """

    mean: str
    std: str = ""
    lost: str = ""
    diverged: str = ""
    failed: str = ""
    agreement: str = ""

    @property
    def marks(self) -> str:
        """What stands behind the number: ``✗1 !2``."""
        counts = [
            f"{DIVERGED}{self.diverged}" if self.diverged else "",
            f"{FAILED}{self.failed}" if self.failed else "",
        ]
        return " ".join(filter(None, [*counts, self.agreement]))

    def __str__(self) -> str:
        spread = f" {PLUS_MINUS} {self.std}" if self.std else ""
        return f"{self.mean}{spread}{self.lost}{f' {self.marks}' if self.marks else ''}"


def cell_text(cell: Cell) -> CellText:
    """The parts that are printed of `cell`."""
    summary = cell.summary
    return CellText(
        mean=MISSING if summary is None else _one_decimal(summary.mean),
        std="" if summary is None or summary.std is None else _one_decimal(summary.std),
        lost=LOST if cell.lost else "",
        diverged=str(len(cell.diverged_seeds) or ""),
        failed=str(len(cell.failed_seeds) or ""),
        agreement=AGREEMENTS[cell.agreement] if cell.agreement else "",
    )


def _one_decimal(value: float) -> str:
    # "z" prints -0.04 as 0.0 rather than -0.0.
    return f"{value:z.1f}"
