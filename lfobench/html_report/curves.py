"""Learning curves as SVG: one small panel per task here, one panel per cell in the page's script, on the same axes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lfobench.plots.captions import demonstration_score, ends, fewer_starts
from lfobench.plots.curves import DIVERGED_SCORE, Curve, evaluated, learning_curve
from lfobench.plots.figure import Look, looks
from lfobench.record import Record
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.exporters.html import Markup, element, joined, name_of
from lfobench.tables.table import Column, Row, Table
from lfobench.text import short_number

WIDTH, HEIGHT = 300.0, 190.0
LEFT, RIGHT, TOP, BOTTOM = 40.0, 10.0, 10.0, 34.0
"""Of a panel, in the units of its view box."""

RANDOM, EXPERT = 0.0, 100.0
_DASH = 1.6
_MARGIN = 0.03


@dataclass(frozen=True)
class Axes:
    """The scales of a task's panels.

    Attributes:
        steps: first and last gradient step.
        scores: lowest and highest score.
        step_ticks: gradient steps with a label.
        score_ticks: scores with a label.
    """

    steps: tuple[float, float]
    scores: tuple[float, float]
    step_ticks: tuple[tuple[float, str], ...]
    score_ticks: tuple[tuple[float, str], ...]

    def x(self, step: float) -> float:
        """Horizontal place of a gradient step."""
        low, high = self.steps
        return LEFT + (WIDTH - LEFT - RIGHT) * (step - low) / (high - low)

    def y(self, score: float) -> float:
        """Vertical place of a score."""
        low, high = self.scores
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (score - low) / (high - low)


@dataclass(frozen=True)
class Panel:
    """The curves of one task."""

    axes: Axes
    steps: list[int]
    curves: Mapping[Column, Curve]


def panels(table: Table, records: Sequence[Record]) -> list[Panel]:
    """One panel per row of `table`."""
    members = {
        column: sorted(of_column, key=lambda record: record.seed)
        for column, of_column in arrange_columns(records).items()
    }
    return [_panel(table, row, members) for _, row in table.rows()]


def column_looks(table: Table, methods: Sequence[str]) -> dict[Column, Look]:
    """Colour and dashes of every method, as in the figures of ``lfobench plot``."""
    return looks([column for column in table.columns if column.run_here], methods)


def dashes(look: Look) -> str | None:
    """`stroke-dasharray` of a look; None for a solid line."""
    return None if isinstance(look.line, str) else " ".join(f"{_DASH * length:g}" for length in look.line[1])


def curves_section(
    table: Table, records: Sequence[Record], drawn: Sequence[Panel], chosen: Mapping[Column, Look]
) -> Markup:
    """Every task's panel with all methods under one legend."""
    rows = [row for _, row in table.rows()]
    diverged = any(curve.diverged for panel in drawn for curve in panel.curves.values())
    known = any(demonstration_score(table, row) is not None for row in rows)
    return element(
        "section",
        element("h2", "Learning curves"),
        element("ul", *(_key(column.label, look) for column, look in chosen.items()), class_="legend"),
        element(
            "div",
            *(
                element(
                    "figure",
                    element("figcaption", name_of(row.task)),
                    _svg(row, panel, chosen, demonstration_score(table, row)),
                )
                for row, panel in zip(rows, drawn, strict=True)
            ),
            class_="panels",
        ),
        element(
            "p",
            "Score of every evaluation against gradient steps, mean over seeds; pointing at a cell of the table shows "
            f"its seeds. Grey lines at 0 and 100 are {ends(table)}."
            + (f" {fewer}" if (fewer := fewer_starts(table, records)) else "")
            + (" Dotted: the demonstration that the methods observe." if known else "")
            + (
                f" A cross marks a divergence, from which on the seed counts as {DIVERGED_SCORE:.0f}."
                if diverged
                else ""
            ),
            class_="caption",
        ),
        id="curves",
    )


def _panel(table: Table, row: Row, members: Mapping[Column, Sequence[Record]]) -> Panel:
    on_task = {column: [each for each in found if each.task == row.task] for column, found in members.items()}
    steps = evaluated([record for found in on_task.values() for record in found])
    curves = {
        column: curve
        for column, found in on_task.items()
        if (curve := learning_curve(found, steps, table.statistic)) is not None
    }
    scores = [score for curve in curves.values() for seed in curve.seeds for score in seed if score is not None]
    demonstration = demonstration_score(table, row)
    points = [RANDOM, EXPERT, *scores, *([demonstration] if demonstration is not None else [])]
    return Panel(_axes(steps, min(points), max(points)), steps, curves)


def _axes(steps: Sequence[int], low: float, high: float) -> Axes:
    first, last = (steps[0], steps[-1]) if steps else (0, 1)
    start = 0 if len(steps) > 1 or first > 0 else first - 1
    end = max(last, start + 1)
    margin = _MARGIN * (high - low)
    return Axes(
        (start, end),
        (low - margin, high + margin),
        tuple((tick, _thousands(tick)) for tick in ticks(start, end)),
        tuple((tick, f"{tick:g}".replace("-", "−")) for tick in ticks(low, high)),
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


def _key(label: str, look: Look) -> Markup:
    line = element(
        "line", x1="1", y1="6", x2="35", y2="6", stroke=look.colour, stroke_dasharray=dashes(look), class_="mean-line"
    )
    return element("li", element("svg", line, viewBox="0 0 36 12", aria_hidden="true"), name_of(label))


def _svg(row: Row, panel: Panel, chosen: Mapping[Column, Look], demonstration: float | None) -> Markup:
    axes = panel.axes
    parts = [_frame(axes)]
    if demonstration is not None:
        parts.append(_across(axes, demonstration, "demonstration"))
    for column, curve in panel.curves.items():
        look = chosen[column]
        places = " ".join(
            f"{axes.x(step):.1f},{axes.y(mean):.1f}" for step, mean in zip(curve.steps, curve.means, strict=True)
        )
        parts.append(
            element(
                "polyline",
                element("title", column.label),
                points=places,
                stroke=look.colour,
                stroke_dasharray=dashes(look),
                class_="mean-line",
            )
        )
        parts += [_cross(axes.x(step), axes.y(DIVERGED_SCORE), look.colour) for step in curve.diverged]
    named = ", ".join(
        f"{column.label} {short_number(curve.means[-1])}" for column, curve in panel.curves.items() if curve.means
    )
    return element(
        "svg",
        joined(parts),
        viewBox=f"0 0 {WIDTH:g} {HEIGHT:g}",
        role="img",
        aria_label=f"Learning curves on {row.task}. Last evaluation, mean over seeds: {named or 'none'}.",
    )


def _frame(axes: Axes) -> Markup:
    """Lines at random and expert, ticks and axis labels."""
    bottom = HEIGHT - BOTTOM
    parts = [_across(axes, score, "reference") for score in (RANDOM, EXPERT)]
    parts.append(
        element("path", d=f"M{LEFT:g} {TOP:g}V{bottom:g}H{WIDTH - RIGHT:g}", class_="axis"),
    )
    for score, label in axes.score_ticks:
        place = f"{axes.y(score):.1f}"
        parts.append(element("line", x1=LEFT - 3, x2=LEFT, y1=place, y2=place, class_="axis"))
        parts.append(element("text", label, x=LEFT - 6, y=f"{axes.y(score) + 3.2:.1f}", text_anchor="end"))
    for step, label in axes.step_ticks:
        place = f"{axes.x(step):.1f}"
        parts.append(element("line", x1=place, x2=place, y1=bottom, y2=bottom + 3, class_="axis"))
        parts.append(element("text", label, x=place, y=bottom + 14, text_anchor="middle"))
    middle = (LEFT + WIDTH - RIGHT) / 2.0
    parts.append(element("text", "gradient steps", x=middle, y=HEIGHT - 4, text_anchor="middle", class_="axis-label"))
    upright = f"rotate(-90 9 {(TOP + bottom) / 2.0:g})"
    parts.append(
        element(
            "text",
            "score",
            x=9.0,
            y=(TOP + bottom) / 2.0,
            text_anchor="middle",
            transform=upright,
            class_="axis-label",
        )
    )
    return joined(parts)


def _across(axes: Axes, score: float, kind: str) -> Markup:
    place = f"{axes.y(score):.1f}"
    return element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=place, y2=place, class_=kind)


def _cross(x: float, y: float, colour: str) -> Markup:
    return element("path", d=f"M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8", stroke=colour, class_="cross")
