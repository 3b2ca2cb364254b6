"""The table model: what every exporter draws, and nothing about how."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from lfobench.score import Statistic
from lfobench.stats.highlight import Outcome, Rule
from lfobench.stats.intervals import Summary
from lfobench.stats.options import Agreement, Scope
from lfobench.stats.successes import Successes
from lfobench.stats.tests import Sample
from lfobench.text import short_number

HIGHLIGHT_NOTE = "Highlighted"
"""Label of the note that explains the highlights; the terminal attaches its mark to it."""


ColumnKind = Literal["actions", "observations", "expert", "published", "incomparable"]
"""The group of a column: methods with expert actions, methods without, the demonstration, published numbers, and
published numbers of another source or protocol."""


@dataclass(frozen=True)
class Column:
    """One method under one preset and one set of options; or the demonstration; or a method as published.

    Attributes:
        label: unique in its column group; the method's name, extended only as far as another column requires.
        method: name of the method.
        preset: name of its preset; empty for what was not run here.
        kind: its column group.
    """

    label: str
    method: str
    preset: str
    kind: ColumnKind

    @property
    def run_here(self) -> bool:
        """Whether the column shows runs of ours."""
        return self.kind in ("actions", "observations")


def competes(column: Column, scope: Scope) -> bool:
    """Whether methods are compared in this column."""
    return column.run_here if scope == "all" else column.kind == "observations"


@dataclass(frozen=True)
class Cell:
    """Normalised scores of one column on one task, over seeds; or how many of its episodes succeeded.

    Attributes:
        sample: the scores, with n, mean and std over seeds; a diverged seed is one of them, with score 0. None where
            every seed failed.
        seeds: the seeds with a score, ascending.
        diverged_seeds: those of them that diverged.
        failed_seeds: seeds that crashed and have no score; not among `seeds`.
        highlighted: whether the highlight rule picks this cell.
        lost: whether it stands out only as long as nobody corrects for the number of rows tested.
        agreement: of a published number: the result of the test that compares ours with it.
        agreement_p: p-value behind `agreement`, where it is one of counts.
    """

    sample: Sample | None
    seeds: tuple[int, ...] = ()
    diverged_seeds: tuple[int, ...] = ()
    failed_seeds: tuple[int, ...] = ()
    highlighted: bool = False
    lost: bool = False
    agreement: Agreement | None = None
    agreement_p: float | None = None

    @property
    def successes(self) -> Successes | None:
        """The counts of a cell that shows counts; None of one that shows scores."""
        return self.sample.successes if self.sample else None

    @property
    def summary(self) -> Summary | None:
        """n, mean and std over seeds."""
        return self.sample.summary if self.sample else None


@dataclass(frozen=True)
class Row:
    """One task.

    Attributes:
        label: short name inside the block, e.g. ``hopper``.
        task: full name, e.g. ``hopper-random-expert``.
        cells: one per column of the table; None where there is no record.
        outcome: of the highlight rule.
        p: p-value of best against second best; None where nothing was tested.
        adjusted_p: `p` corrected for the number of rows tested, by Holm where the rule says no correction.
        without_spread: whether `p` is a limit, for want of any spread that a t-test could estimate.
    """

    label: str
    task: str
    cells: tuple[Cell | None, ...]
    outcome: Outcome
    p: float | None
    adjusted_p: float | None
    without_spread: bool = False


@dataclass(frozen=True)
class Block:
    """Rows under one heading, e.g. ``random+expert``."""

    label: str
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Note:
    """One entry of the footnote."""

    label: str
    text: str


@dataclass(frozen=True)
class ColumnGroup:
    """Neighbouring columns under one heading: ``columns[start:stop]``."""

    label: str
    start: int
    stop: int


@dataclass(frozen=True)
class Table:
    """Scores of methods (columns) on tasks (rows) from one source under one protocol.

    Attributes:
        columns: in table order, those of a group adjacent.
        blocks: the rows.
        notes: the footnote.
        statistic: what a run's evaluations were reduced to.
        rule: what decided the highlights.
        source: where the data came from.
        protocol: name of the protocol.
        success_rates: whether every score is a success rate in per cent.
    """

    columns: tuple[Column, ...]
    blocks: tuple[Block, ...]
    notes: tuple[Note, ...]
    statistic: Statistic
    rule: Rule
    source: str
    protocol: str
    success_rates: bool = False

    @property
    def counts(self) -> bool:
        """Whether cells show success counts; else they show scores."""
        return self.rule.test == "fisher"

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        # The exporters import this module.
        from lfobench.tables.exporters.html import export

        return export(self)

    def rows(self) -> Iterator[tuple[Block, Row]]:
        """Every row with its block, in table order."""
        for block in self.blocks:
            for row in block.rows:
                yield block, row

    def cells(self) -> Iterator[tuple[Row, Column, Cell | None]]:
        """Every cell with its row and column, row by row."""
        for _, row in self.rows():
            for column, cell in zip(self.columns, row.cells, strict=True):
                yield row, column, cell


GROUP_LABELS: dict[ColumnKind, str] = {
    "actions": "Access to expert actions",
    "observations": "No expert actions",
    "expert": "Expert",
    "published": "Published",
    "incomparable": "Published, not comparable",
}


def column_groups(columns: tuple[Column, ...]) -> tuple[ColumnGroup, ...]:
    """The seed paper's column groups, in the order of `GROUP_LABELS`; an empty group is left out."""
    groups, start = [], 0
    for kind, label in GROUP_LABELS.items():
        stop = start + sum(column.kind == kind for column in columns)
        if stop > start:
            groups.append(ColumnGroup(label, start, stop))
        start = stop
    return tuple(groups)


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
        """Interval of a success rate: ``[77, 93]``."""
        return f"[{self.low}, {self.high}]" if self.low else ""

    @property
    def verdict(self) -> str:
        """Agreement with a published number: its sign, and p where there is one: ``≠ p 0.03``."""
        return f"{self.agreement}{f' p {self.p}' if self.p else ''}"

    @property
    def marks(self) -> str:
        """Marks after the number: ``✗1 !2``."""
        counts = [
            f"{DIVERGED}{self.diverged}" if self.diverged else "",
            f"{FAILED}{self.failed}" if self.failed else "",
        ]
        return " ".join(filter(None, [*counts, self.verdict]))

    def __str__(self) -> str:
        spread = f" {PLUS_MINUS} {self.std}" if self.std else f" {self.interval}" if self.interval else ""
        return f"{self.mean}{spread}{self.lost}{f' {self.marks}' if self.marks else ''}"


def cell_text(cell: Cell) -> CellText:
    """The printed parts of `cell`."""
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


def compact_text(cell: Cell) -> CellText:
    """The printed parts of `cell` where there is little space: of a success rate, whole per cent alone."""
    text = cell_text(cell)
    if cell.successes is None:
        return text
    rate = 100.0 * cell.successes.pooled.successes / cell.successes.pooled.trials
    return replace(text, mean=f"{rate:.0f}%", low="", high="", p="")


def _numbers(cell: Cell) -> tuple[str, str, str, str]:
    """Number, standard deviation, ends of the interval; what a cell lacks is empty, and a missing number a dash."""
    summary, successes = cell.summary, cell.successes
    if successes is not None:
        low, high = (f"{100.0 * end:.0f}" for end in (successes.interval.low, successes.interval.high))
        return f"{successes.pooled.successes}/{successes.pooled.trials}", "", low, high
    if summary is None:
        return CRASHED if cell.failed_seeds else MISSING, "", "", ""
    return short_number(summary.mean), "" if summary.std is None else short_number(summary.std), "", ""
