"""The characters of a cell: shared by the exporters, so that every format prints the same number."""

from __future__ import annotations

from dataclasses import dataclass

from lfobench.render.table import Cell
from lfobench.stats.names import Agreement
from lfobench.words import short_number

PLUS_MINUS = "±"
MISSING = "–"
DIVERGED = "✗"
FAILED = "!"
CRASHED = "crashed"
LOST = "†"
AGREEMENTS: dict[Agreement, str] = {"matches": "≈", "differs": "≠", "undecided": "?", "not told apart": "∼"}


@dataclass(frozen=True)
class CellText:
    """The parts of one cell: scores to one decimal, or counts with an interval in whole per cent.

    Attributes:
        mean: e.g. ``97.9``, or successes out of trials, ``61/70``; ``crashed`` where every seed failed.
        std: e.g. ``8.1``; empty for a single seed.
        lost: a dagger where the highlight does not survive a correction, else empty.
        diverged: number of diverged seeds, e.g. ``1``; empty for none.
        failed: number of failed seeds; empty for none.
        agreement: sign of a published number against ours; empty elsewhere.
        low: lower end of the interval of a success rate, in whole per cent; empty for a score.
        high: upper end.
        p: behind `agreement` where it is one of counts, e.g. ``0.03`` or ``<0.001``.
    """

    mean: str
    std: str = ""
    lost: str = ""
    diverged: str = ""
    failed: str = ""
    agreement: str = ""
    low: str = ""
    high: str = ""
    p: str = ""

    @property
    def interval(self) -> str:
        """What stands behind a count: ``[77, 93]``."""
        return f"[{self.low}, {self.high}]" if self.low else ""

    @property
    def verdict(self) -> str:
        """What is said of a published number: its sign, and p where there is one: ``≠ p 0.03``."""
        return f"{self.agreement}{f' p {self.p}' if self.p else ''}"

    @property
    def marks(self) -> str:
        """What stands behind the number: ``✗1 !2``."""
        counts = [
            f"{DIVERGED}{self.diverged}" if self.diverged else "",
            f"{FAILED}{self.failed}" if self.failed else "",
        ]
        return " ".join(filter(None, [*counts, self.verdict]))

    def __str__(self) -> str:
        spread = f" {PLUS_MINUS} {self.std}" if self.std else f" {self.interval}" if self.interval else ""
        return f"{self.mean}{spread}{self.lost}{f' {self.marks}' if self.marks else ''}"


def cell_text(cell: Cell) -> CellText:
    """The parts that are printed of `cell`."""
    number, std, low, high = _numbers(cell)
    return CellText(
        mean=number,
        std=std,
        lost=LOST if cell.lost else "",
        diverged=str(len(cell.diverged_seeds) or ""),
        failed=str(len(cell.failed_seeds) or ""),
        agreement=AGREEMENTS[cell.agreement] if cell.agreement else "",
        low=low,
        high=high,
        p="" if cell.agreement_p is None else "<0.001" if cell.agreement_p < 0.001 else f"{cell.agreement_p:.2g}",
    )


def _numbers(cell: Cell) -> tuple[str, str, str, str]:
    """Number, standard deviation, ends of the interval; what a cell lacks is empty, and a missing number a dash."""
    summary, successes = cell.summary, cell.successes
    if successes is not None:
        low, high = (f"{100.0 * end:.0f}" for end in (successes.interval.low, successes.interval.high))
        return f"{successes.pooled.successes}/{successes.pooled.trials}", "", low, high
    if summary is None:
        return CRASHED if cell.failed_seeds else MISSING, "", "", ""
    return short_number(summary.mean), "" if summary.std is None else short_number(summary.std), "", ""
