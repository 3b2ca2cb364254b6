"""Scores against the share of successes in the offline data, for tasks that differ in nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile

from matplotlib.ticker import FixedLocator

from lfobench.errors import UserError
from lfobench.plots.captions import LEVEL, caption, references, run_cells, run_columns, run_score, score_label
from lfobench.plots.figure import PaperFigure, legend, looks, panels, reference_lines, score_limits, style
from lfobench.record import Record
from lfobench.stats.intervals import Interval, summarize, t_interval
from lfobench.tables.table import Column, Row, Table
from lfobench.text import canonical_json

_PANEL_HEIGHT = 1.3
_SHARE = "success_share"
_LEVEL_FIELDS = ("offline", "offline_trajectories", _SHARE)
"""Fields of a recipe in which the tasks of a panel may differ; recordings of a level are longer than another's."""


@dataclass(frozen=True)
class Point:
    """Mean over seeds at one share, and its t-interval; None of fewer than two seeds."""

    share: float
    mean: float
    interval: Interval | None


def success_share(table: Table, records: Sequence[Record], width: float, methods: Sequence[str] = ()) -> PaperFigure:
    """One panel per task whose offline data has several shares of successes; a line per method.

    Args:
        table: made of `records`.
        records: with the recipes.
        width: inches.
        methods: names in the order in which colours are handed out.

    Raises:
        UserError: no task has several shares.
    """
    families = _families(table, records)
    columns = run_columns(table)
    found = [_lines(columns, rows, table) for rows in families.values()]
    points = [point for panel in found for line in panel.values() for point in line]
    ends = [end for point in points if point.interval for end in (point.interval.low, point.interval.high)]
    limits = score_limits([point.mean for point in points], ends)
    with style():
        figure, axes = panels(list(families), width, _PANEL_HEIGHT)
        chosen = looks(columns, methods)
        for panel, lines in zip(axes, found, strict=True):
            reference_lines(panel, "y", None)
            for column, line in lines.items():
                look, shares = chosen[column], [100.0 * point.share for point in line]
                panel.plot(
                    shares,
                    [point.mean for point in line],
                    color=look.colour,
                    linestyle=look.line,
                    marker=look.marker,
                )
                banded = [point for point in line if point.interval is not None]
                panel.fill_between(
                    [100.0 * point.share for point in banded],
                    [point.interval.low for point in banded if point.interval],
                    [point.interval.high for point in banded if point.interval],
                    color=look.colour,
                    alpha=0.15,
                    linewidth=0.0,
                )
            panel.set_ylim(*limits)
            panel.xaxis.set_major_locator(FixedLocator(sorted({100.0 * point.share for point in points})))
        figure.supxlabel("successes among the offline trajectories in %")
        figure.supylabel(score_label(table))
        legend(figure, chosen)
    cut = any(not limits[0] <= end <= limits[1] for end in ends)
    return figure.settle(
        caption(
            "Scores against the share of successes among the trajectories of the offline data, mean over seeds.",
            f"Bands: {LEVEL:.0%} t-intervals of the mean{', cut by the axis' if cut else ''}.",
            f"{run_score(table)}. {references(table)}",
            table=table,
        )
    )


def _families(table: Table, records: Sequence[Record]) -> dict[str, list[tuple[float, Row]]]:
    """Title to the shares and rows of tasks that differ in the share of successes alone.

    Raises:
        UserError: there are none.
    """
    recipes = {record.task: (record.identity["recipe"], record.identity["environment"]) for record in records}
    grouped: dict[str, list[tuple[float, Row]]] = {}
    for _, row in table.rows():
        recipe, environment = recipes.get(row.task, ({}, {}))
        if _SHARE in recipe:
            rest = {name: value for name, value in recipe.items() if name not in _LEVEL_FIELDS}
            grouped.setdefault(canonical_json([rest, environment]), []).append((float(recipe[_SHARE]), row))
    families = [sorted(rows, key=lambda each: each[0]) for rows in grouped.values() if len(rows) > 1]
    if not families:
        raise UserError(
            "No task of these records has offline data with several shares of successes.",
            "Run such a suite first, e.g. lfobench run --suite airhockey-share.",
        )
    return {_title([row.task for _, row in rows]): rows for rows in families}


def _title(tasks: Sequence[str]) -> str:
    """Words with which the names of all the tasks begin."""
    words = takewhile(lambda each: len(set(each)) == 1, zip(*(task.split("-") for task in tasks), strict=False))
    return "-".join(word for word, *_ in words) or tasks[0]


def _lines(columns: Sequence[Column], rows: Sequence[tuple[float, Row]], table: Table) -> Mapping[Column, list[Point]]:
    lines: dict[Column, list[Point]] = {}
    for share, row in rows:
        for column, cell in run_cells(table, row).items():
            if cell.sample is not None:
                summary = summarize(cell.sample.seeds)
                lines.setdefault(column, []).append(Point(share, summary.mean, t_interval(summary, LEVEL)))
    return {column: lines[column] for column in columns if column in lines}
