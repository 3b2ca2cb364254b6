"""Training metrics against updates: the mean over seeds, one panel per metric and task."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter, MaxNLocator

from lfobench.errors import UserError, unknown_name
from lfobench.plots.captions import caption, run_columns
from lfobench.plots.figure import WIDTHS, Look, PaperFigure, legend, looks, panels, style
from lfobench.record import LARGEST_SCORE, Record, usable
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.table import Column, Table
from lfobench.text import short_number

MOST_PANELS = 40
"""On one page."""

_PANEL_HEIGHT = 0.9
_LOGARITHMIC_FROM = 1000.0
"""Ratio of the largest to the smallest value of a panel, all of them positive, from which on its axis has powers."""


@dataclass(frozen=True)
class _Panel:
    """One metric of one training stage on one task: by column, one line of (update, value) per seed."""

    stage: str
    metric: str
    task: str
    lines: Mapping[Column, Sequence[Mapping[int, float]]]

    def values(self) -> Iterator[float]:
        return (value for lines in self.lines.values() for line in lines for value in line.values())


def metrics(
    table: Table,
    records: Sequence[Record],
    width: float = WIDTHS["column"],
    methods: Sequence[str] = (),
    names: Sequence[str] = (),
) -> PaperFigure:
    """One panel per metric, stage and task; a thick line per method is the mean over its seeds, which are thin.

    Args:
        table: made of `records`.
        records: with their metrics.
        width: inches.
        methods: names in the order in which colours are handed out, see `style.looks`.
        names: the metrics to draw; empty for all.

    Raises:
        UserError: no record has a metric, or none of a name, or there are more panels than fit on a page.
    """
    rows = [row.task for _, row in table.rows()]
    found = _panels(records, rows, names)
    columns = run_columns(table)
    left_out = sum(not usable(value) for record in records for value in _values(record, names))
    tasks, stages = {panel.task for panel in found}, {panel.stage for panel in found}
    with style():
        titles = [_title(panel, len(stages) > 1, len(tasks) > 1) for panel in found]
        figure, axes = panels(titles, width, _PANEL_HEIGHT, share_x=False, share_y=False)
        chosen = looks(columns, methods)
        for place, panel in zip(axes, found, strict=True):
            for index, (column, lines) in enumerate(panel.lines.items()):
                _draw(place, lines, chosen[column], index / len(columns))
            values = list(panel.values())
            if values and min(values) > 0.0 and max(values) > _LOGARITHMIC_FROM * min(values):
                place.set_yscale("log")
            else:
                place.yaxis.set_major_locator(MaxNLocator(3))
            place.xaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
            place.xaxis.set_major_formatter(EngFormatter(sep=""))
        figure.supxlabel("updates")
        legend(figure, {column: chosen[column] for column in columns if any(column in each.lines for each in found)})
    beyond = f"Left out: {left_out:,} values that are not finite or beyond ±{short_number(LARGEST_SCORE)}."
    return figure.settle(
        caption(
            "Training metrics: each point is the mean over the updates since the one before it; thick: mean over "
            "seeds, thin: seeds. Axes differ from panel to panel.",
            beyond if left_out else "",
            table=table,
        )
    )


def _panels(records: Sequence[Record], tasks: Sequence[str], names: Sequence[str]) -> list[_Panel]:
    keys = dict.fromkeys((row.stage, metric) for record in records for row in record.metrics for metric in row.values)
    known = dict.fromkeys(metric for _, metric in keys)
    if not known:
        raise UserError("These records hold no training metrics.", "Draw 'curves' instead: they are scores.")
    for name in names:
        if name not in known:
            raise unknown_name("metric of these records", name, known)
    columns = arrange_columns(records)
    found = []
    for task in tasks:
        for stage, metric in keys:
            if names and metric not in names:
                continue
            lines = {
                column: kept
                for column, members in columns.items()
                if (kept := [line for each in members if each.task == task and (line := _line(each, stage, metric))])
            }
            if lines:
                found.append(_Panel(stage, metric, task, lines))
    if not found:
        raise UserError("None of these metrics was ever a number that can be drawn.", "Choose others with --metric.")
    if len(found) > MOST_PANELS:
        raise UserError(
            f"{len(found)} panels, one per metric and task, do not fit on a page (at most {MOST_PANELS}).",
            f"Choose with --metric, --methods or --suite. Metrics: {', '.join(list(known)[:30])}.",
        )
    return found


def _line(record: Record, stage: str, metric: str) -> dict[int, float]:
    return {row.step: value for row in record.metrics if row.stage == stage and usable(value := row.values.get(metric))}


def _values(record: Record, names: Sequence[str]) -> Iterator[float | None]:
    return (value for row in record.metrics for name, value in row.values.items() if not names or name in names)


def _title(panel: _Panel, with_stage: bool, with_task: bool) -> str:
    stage = f" ({panel.stage})" if with_stage else ""
    return f"{panel.metric}{stage}{f', {panel.task}' if with_task else ''}"


def _draw(axes: Axes, lines: Sequence[Mapping[int, float]], look: Look, offset: float) -> None:
    steps = sorted({step for line in lines for step in line})
    means = []
    for step in steps:
        there = [line[step] for line in lines if step in line]
        means.append(sum(there) / len(there))
    # Markers of different methods lie at different places, or they would hide each other where lines meet.
    every = (0.25 * offset, 0.25) if len(steps) > 1 else None
    axes.plot(steps, means, color=look.colour, linestyle=look.line, marker=look.marker, markevery=every)
    for line in lines if len(lines) > 1 else ():
        axes.plot(list(line), list(line.values()), color=look.colour, linestyle=look.line, linewidth=0.4)
