"""Scores: every seed of every method, with their mean and its interval, one panel per task."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from lfobench.render.cell_text import FAILED, MISSING
from lfobench.render.plots.captions import DEMONSTRATION, caption, references, run_score, score_label
from lfobench.render.plots.compared import LEVEL, demonstration_score, run_cells, run_columns
from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.grid import panels, reference_lines, score_limits
from lfobench.render.plots.style import INK, PAPER, SMALL_SIZE, WIDTHS, Look, looks, style
from lfobench.render.plots.text import text_height, wrapped
from lfobench.render.table import Cell, Table
from lfobench.stats.intervals import Interval, t_interval

_LINE_INCHES = 0.17
_SPREAD = 0.26
"""Seeds lie up to so far, in lines, above and below the middle of their method's line."""


def scores(table: Table, width: float = WIDTHS["column"], methods: Sequence[str] = ()) -> PaperFigure:
    """One panel per task of `table`, one line per method: a dot per seed, or a cross where the seed diverged.

    Args:
        table: with the scores.
        width: inches.
        methods: names in the order in which colours are handed out, see `style.looks`.
    """
    columns = run_columns(table)
    rows = [row for _, row in table.rows()]
    cells = [run_cells(table, row) for row in rows]
    demonstrations = [demonstration_score(table, row) for row in rows]
    counted = [score for row in cells for cell in row.values() if cell.sample for score in cell.sample.seeds]
    known = [score for score in demonstrations if score is not None]
    ends = [
        end
        for row in cells
        for cell in row.values()
        if (interval := _interval(cell)) is not None
        for end in (interval.low, interval.high)
    ]
    limits = score_limits([*counted, *known], ends)
    with style():
        labels = [wrapped(column.label, SMALL_SIZE, width / 4.0) for column in columns]
        line_height = max(_LINE_INCHES, *(text_height(label, SMALL_SIZE) + 0.04 for label in labels))
        figure, axes = panels([row.task for row in rows], width, line_height * len(columns) + 0.15)
        chosen = looks(columns, methods)
        for panel, row, demonstration in zip(axes, cells, demonstrations, strict=True):
            reference_lines(panel, "x", demonstration)
            for line, column in enumerate(columns):
                _draw(panel, row.get(column), line, chosen[column], limits)
            panel.set_xlim(*limits)
            panel.set_ylim(len(columns) - 0.5, -0.5)
            panel.tick_params(axis="y", length=0.0)
        axes[0].set_yticks(range(len(columns)), labels)
        figure.supxlabel(score_label(table))
    return figure.settle(
        caption(
            "Scores per task: every dot is one seed, a cross one that diverged; the tick is their mean, "
            f"the line its {LEVEL:.0%} t-interval (none for one seed; an arrow where the axis cuts it).",
            f"{FAILED}k at the edge: k seeds crashed and have no score."
            if any(cell.failed_seeds for row in cells for cell in row.values())
            else "",
            f"{MISSING} at the edge: no run." if any(len(row) < len(columns) for row in cells) else "",
            f"{run_score(table)} {references(table)}",
            DEMONSTRATION if known else "",
            table=table,
        )
    )


def _interval(cell: Cell) -> Interval | None:
    return t_interval(cell.summary, LEVEL) if cell.summary else None


def _draw(axes: Axes, cell: Cell | None, line: int, look: Look, limits: tuple[float, float]) -> None:
    if cell is None or cell.failed_seeds:
        text = MISSING if cell is None else f"{FAILED}{len(cell.failed_seeds)}"
        axes.annotate(
            text, (1.0, line), (1.0, 0.0), axes.get_yaxis_transform(), "offset points", va="center", fontsize=SMALL_SIZE
        )
    if cell is None or cell.sample is None or cell.summary is None:
        return
    interval = _interval(cell)
    if interval is not None:
        axes.plot([interval.low, interval.high], [line, line], color=INK, linewidth=0.8, zorder=1)
        for end, edge, marker in ((interval.low, limits[0], "<"), (interval.high, limits[1], ">")):
            if (end < edge) if marker == "<" else (end > edge):
                axes.plot([edge], [line], marker, color=INK, markersize=3.0, clip_on=False)
    axes.plot([cell.summary.mean] * 2, [line - 0.36, line + 0.36], color=INK, linewidth=1.2, zorder=1.5)
    heights = line + (np.linspace(-_SPREAD, _SPREAD, len(cell.seeds)) if len(cell.seeds) > 1 else np.zeros(1))
    diverged = np.isin(cell.seeds, cell.diverged_seeds)
    values = np.array(cell.sample.seeds)
    axes.scatter(
        values[~diverged],
        heights[~diverged],
        13.0,
        color=look.colour,
        marker=look.marker,
        zorder=2,
        linewidths=0.4,
        edgecolors=PAPER,
        clip_on=False,
    )
    if diverged.any():
        axes.scatter(
            values[diverged],
            heights[diverged],
            14.0,
            color=look.colour,
            marker="x",
            zorder=3,
            linewidths=1.2,
            clip_on=False,
        )
