"""Probability of improvement: how often a run of one method beats a run of another, for every pair of methods.

R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare, "Deep reinforcement learning at the edge of
the statistical precipice", NeurIPS 2021, section 4.3.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from lfobench.errors import UserError
from lfobench.render.plots.captions import caption, run_score, shared_tasks
from lfobench.render.plots.compared import LEVEL, compare
from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.style import INK, LABEL_SIZE, PAPER, SMALL_SIZE, WIDTHS, style
from lfobench.render.plots.text import plain, text_height, text_width, wrapped
from lfobench.render.table import Table
from lfobench.stats.aggregates import probability_of_improvement
from lfobench.stats.bootstrap import REPLICATES
from lfobench.stats.intervals import Estimate, Interval

# Blue is darker than orange, so that the two ends differ in grey as well; both leave black text readable.
MAP = LinearSegmentedColormap.from_list("improvement", ["#F2C14E", "#FAFAFA", "#4296CC"])
_DIAGONAL = "#d0d0d0"
_CELL_HEIGHT = 0.36
_EDGES = 0.2
"""Inches beside the matrix that are neither cells nor names."""


def improvement(table: Table, width: float = WIDTHS["column"]) -> PaperFigure:
    """A matrix of P(row > column) in per cent with its interval; bold where the interval leaves out one half.

    Args:
        table: with the scores.
        width: inches.

    Raises:
        UserError: there is one method, or the methods share no task.
    """
    compared = compare(table)
    columns = compared.columns
    if len(columns) < 2:
        raise UserError("A probability of improvement needs two methods; there is one.", "Run another beside it.")
    found: dict[tuple[int, int], Estimate] = {}
    for first, second in combinations(range(len(columns)), 2):
        estimate = probability_of_improvement(compared.scores[columns[first]], compared.scores[columns[second]], LEVEL)
        found[first, second], found[second, first] = estimate, _swapped(estimate)
    with style():
        rows = [wrapped(column.label, LABEL_SIZE, width / 4.0) for column in columns]
        across = (width - max(text_width(label, LABEL_SIZE) for label in rows) - _EDGES) / len(columns)
        upright = max(text_width(plain(column.label), LABEL_SIZE) for column in columns) > across
        # An upright heading has the room that its cell is wide; the rows have the same names in the same order.
        lines = max(1, int(across / text_height("", LABEL_SIZE)))
        heads = [
            wrapped(column.label, LABEL_SIZE, width / 4.0, lines) if upright else plain(column.label)
            for column in columns
        ]
        above = max(text_width(head, LABEL_SIZE) if upright else text_height(head, LABEL_SIZE) for head in heads)
        stacked = text_width("100–100", SMALL_SIZE) > across - 0.03
        down = _CELL_HEIGHT + (text_height("", SMALL_SIZE) if stacked else 0.0)
        figure = PaperFigure(width, down * len(columns) + above + 0.4)
        axes = figure.subplots()
        _matrix(axes, found, len(columns), stacked)
        axes.set_xticks(range(len(columns)), heads, rotation=90 if upright else 0, fontsize=LABEL_SIZE)
        axes.set_yticks(range(len(columns)), rows, fontsize=LABEL_SIZE)
        axes.set_xlabel("P(row > column), %")
        axes.xaxis.set_label_position("top")
    drawn = any(estimate.interval for estimate in found.values())
    return figure.settle(
        caption(
            "Probability of improvement, in per cent: that a run of the row's method scores higher than a run of the "
            "column's on the same task, averaged over tasks; ties count one half.",
            f"Below it the {LEVEL:.0%} interval of a bootstrap stratified by task, {REPLICATES:,} replicates; "
            "bold where it leaves out 50, uncorrected for the number of pairs."
            if drawn
            else "There are no intervals: with one run per task, or runs that never overlap, "
            "the bootstrap shows no spread.",
            shared_tasks(compared),
            run_score(table),
            table=table,
        )
    )


def _swapped(estimate: Estimate) -> Estimate:
    """P(column > row) from P(row > column): ties count one half, so the two add up to 1."""
    interval = estimate.interval
    return Estimate(
        1.0 - estimate.value, interval and Interval(1.0 - interval.high, 1.0 - interval.low, interval.level)
    )


def _matrix(axes: Axes, found: dict[tuple[int, int], Estimate], size: int, stacked: bool) -> None:
    """The cells; their intervals in two lines where they are `stacked`."""
    values = np.full((size, size), np.nan)
    for place, estimate in found.items():
        values[place] = estimate.value
    axes.set_facecolor(_DIAGONAL)
    edges = np.arange(size + 1) - 0.5
    axes.pcolormesh(edges, edges, values, cmap=MAP, vmin=0.0, vmax=1.0, edgecolors=PAPER, linewidth=0.6)
    axes.set_ylim(size - 0.5, -0.5)
    axes.tick_params(length=0.0, top=False, labeltop=True, bottom=False, labelbottom=False)
    axes.spines[:].set_visible(False)
    for (row, column), estimate in found.items():
        interval = estimate.interval
        decided = interval is not None and not interval.low <= 0.5 <= interval.high
        weight = "bold" if decided else "normal"
        where: dict[str, Any] = {"color": INK, "ha": "center"}
        if interval is None:
            axes.text(column, row, _percent(estimate.value), fontweight=weight, va="center", **where)
            continue
        split = row - (0.13 if stacked else 0.0)
        dash = "–\n" if stacked else "–"
        text = f"{_percent(interval.low)}{dash}{_percent(interval.high)}"
        axes.text(column, split, _percent(estimate.value), fontweight=weight, va="bottom", **where)
        axes.text(column, split + 0.06, text, fontsize=SMALL_SIZE, linespacing=1.0, va="top", **where)


def _percent(probability: float) -> str:
    return f"{100.0 * probability:.0f}"
