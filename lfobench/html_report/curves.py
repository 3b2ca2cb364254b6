"""Learning curves as the page draws them: a panel per task, and the curves and numbers of each of its cells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from lfobench.plots.captions import LEVEL, demonstration_score, ends, fewer_starts
from lfobench.plots.curves import DIVERGED_SCORE, Curve, evaluated, learning_curve
from lfobench.plots.figure import EXPERT, RANDOM, Look
from lfobench.record import Record
from lfobench.stats.intervals import t_interval
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.table import Cell, Column, Row, Table
from lfobench.text import counted, short_number

_MARGIN = 0.03
_DASH = 1.6


@dataclass(frozen=True)
class Axes:
    """The scales of a task's drawings, in the units of their view box.

    Attributes:
        steps: first and last gradient step.
        scores: lowest and highest score.
        step_ticks: gradient steps with a label.
        score_ticks: scores with a label.
    """

    width: ClassVar = 300
    height: ClassVar = 190
    left: ClassVar = 40
    right: ClassVar = 290
    top: ClassVar = 10
    bottom: ClassVar = 156
    random: ClassVar = RANDOM
    expert: ClassVar = EXPERT

    steps: tuple[float, float]
    scores: tuple[float, float]
    step_ticks: tuple[tuple[float, str], ...]
    score_ticks: tuple[tuple[float, str], ...]

    def x(self, step: float) -> float:
        """Horizontal place of a gradient step."""
        low, high = self.steps
        return self.left + (self.right - self.left) * (step - low) / (high - low)

    def y(self, score: float) -> float:
        """Vertical place of a score."""
        low, high = self.scores
        return self.bottom - (self.bottom - self.top) * (score - low) / (high - low)

    def path(self, steps: Sequence[int], scores: Sequence[float | None]) -> str:
        """A line through the known scores; it is broken where one is missing."""
        pen, parts = "M", []
        for step, score in zip(steps, scores, strict=True):
            if score is not None:
                parts.append(f"{pen}{self.x(step):.1f} {self.y(score):.1f}")
            pen = "M" if score is None else "L"
        return "".join(parts)


@dataclass(frozen=True)
class DrawnCell:
    """Details of a cell of the table, shown on demand: its seeds' curves, and the numbers behind its mean.

    Attributes:
        column: its method.
        place: of the column in the table.
        curve: None where no run was evaluated.
        facts: texts by name.
    """

    column: Column
    place: int
    curve: Curve | None
    facts: Mapping[str, str]


@dataclass(frozen=True)
class Panel:
    """The curves of one task."""

    task: str
    axes: Axes
    curves: Mapping[Column, Curve]
    cells: tuple[DrawnCell, ...]
    demonstration: float | None

    @property
    def last_means(self) -> str:
        """Mean over seeds of every method's last evaluation, for readers that do not see the drawing."""
        return ", ".join(f"{column.label} {short_number(curve.means[-1])}" for column, curve in self.curves.items())


def panels(table: Table, records: Sequence[Record]) -> list[Panel]:
    """One panel per row of `table`."""
    members = {
        column: sorted(of_column, key=lambda record: record.seed)
        for column, of_column in arrange_columns(records).items()
    }
    return [_panel(table, row, members) for _, row in table.rows()]


def curves_caption(table: Table, records: Sequence[Record], drawn: Sequence[Panel]) -> str:
    """Caption of the panels."""
    sentences = [
        "Score of every evaluation against gradient steps, mean over seeds; pointing at a cell of the table shows its "
        f"seeds. Grey lines at 0 and 100 are {ends(table)}.",
        fewer_starts(table, records),
    ]
    if any(panel.demonstration is not None for panel in drawn):
        sentences.append("Dotted: the demonstration that the methods observe.")
    if any(curve.diverged for panel in drawn for curve in panel.curves.values()):
        sentences.append(
            f"A cross marks a divergence, from which on the seed counts as {DIVERGED_SCORE:.0f}.",
        )
    return " ".join(filter(None, sentences))


def dashes(look: Look) -> str | None:
    """`stroke-dasharray` of a look; None for a solid line."""
    return None if isinstance(look.line, str) else " ".join(f"{_DASH * length:g}" for length in look.line[1])


def _panel(table: Table, row: Row, members: Mapping[Column, Sequence[Record]]) -> Panel:
    on_task = {column: [each for each in found if each.task == row.task] for column, found in members.items()}
    steps = evaluated([record for found in on_task.values() for record in found])
    curves = {
        column: curve
        for column, found in on_task.items()
        if (curve := learning_curve(found, steps, table.statistic)) is not None
    }
    cells = tuple(
        DrawnCell(column, place, curves.get(column), _facts(cell))
        for place, (column, cell) in enumerate(zip(table.columns, row.cells, strict=True))
        if cell is not None and column.run_here
    )
    demonstration = demonstration_score(table, row)
    scores = [score for curve in curves.values() for seed in curve.seeds for score in seed if score is not None]
    points = [RANDOM, EXPERT, *scores, *([demonstration] if demonstration is not None else [])]
    return Panel(row.task, _axes(steps, min(points), max(points)), curves, cells, demonstration)


def _axes(steps: Sequence[int], low: float, high: float) -> Axes:
    first, last = (steps[0], steps[-1]) if steps else (0, 1)
    start = 0 if len(steps) > 1 or first > 0 else first - 1
    end = max(last, start + 1)
    margin = _MARGIN * (high - low)
    return Axes(
        (start, end),
        (low - margin, high + margin),
        tuple((tick, _thousands(tick)) for tick in ticks(start, end)),
        tuple((tick, _signed(f"{tick:g}")) for tick in ticks(low, high)),
    )


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """At most `most` + 1 multiples of 1, 2 or 5 times a power of ten between two numbers, the first the smaller."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    # A quotient such as 0.3 / 0.1 is a little off a whole number.
    slack = 1e-9
    distance = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough * (1.0 - slack))
    first, last = math.ceil(low / distance - slack), math.floor(high / distance + slack)
    return [round(index * distance, 10) for index in range(first, last + 1)]


def _thousands(steps: float) -> str:
    for size, unit in ((1e6, "M"), (1e3, "k")):
        if steps >= size:
            return f"{steps / size:g}{unit}"
    return f"{steps:g}"


def _facts(cell: Cell) -> dict[str, str]:
    facts = {"n": counted(len(cell.seeds), "seed")}
    if cell.sample is not None:
        summary = cell.sample.summary
        facts["mean"] = _decimals(summary.mean)
        facts["std"] = "none: one seed" if summary.std is None else _decimals(summary.std)
        if interval := t_interval(summary, LEVEL):
            facts[f"{LEVEL:.0%} t-interval"] = f"[{_decimals(interval.low)}, {_decimals(interval.high)}]"
        facts["scores"] = ", ".join(
            f"seed {seed}: {_decimals(score)}" for seed, score in zip(cell.seeds, cell.sample.seeds, strict=True)
        )
    for name, seeds in (
        ("diverged, counted as 0", cell.diverged_seeds),
        ("failed, not counted", cell.failed_seeds),
    ):
        if seeds:
            facts[name] = f"seed {', '.join(map(str, seeds))}"
    return facts


def _decimals(score: float) -> str:
    return _signed(short_number(score, "z.2f"))


def _signed(number: str) -> str:
    """A number with a minus sign in place of its hyphen."""
    return number.replace("-", "−")
