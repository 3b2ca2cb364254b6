"""Critical-difference diagram: average ranks over tasks, and which methods the tasks do not tell apart.

J. Demšar, "Statistical comparisons of classifiers over multiple data sets", Journal of Machine Learning Research 7,
2006, figure 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from lfobench.errors import UserError
from lfobench.render.plots.captions import caption, run_score, shared_tasks
from lfobench.render.plots.compared import LEVEL, compare
from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.style import INK, LABEL_SIZE, SMALL_SIZE, WIDTHS, Look, looks, style
from lfobench.render.plots.text import text_height, text_width, wrapped
from lfobench.render.table import Table
from lfobench.stats.ranking import average_ranks, critical_difference, friedman_test, groups

_TASKS, _METHODS = 2, 3
_ALPHA = 1.0 - LEVEL

# Inches: the bracket of the critical difference, the axis, the distance of two bars, the gap between two methods.
_BRACKET, _AXIS, _BAR, _GAP = 0.22, 0.52, 0.09, 0.065
_MARGIN = 0.06


def ranking(table: Table, width: float = WIDTHS["column"], methods: Sequence[str] = ()) -> PaperFigure:
    """Methods at their average rank, best at the left; a bar joins those within the critical difference.

    Args:
        table: with the scores; a method's score on a task is the mean over its seeds.
        width: inches.
        methods: names in the order in which colours are handed out, see `style.looks`.

    Raises:
        UserError: there are fewer than two tasks or three methods to rank.
    """
    compared = compare(table)
    tasks, count = len(compared.tasks), len(compared.columns)
    if tasks < _TASKS or count < _METHODS:
        raise UserError(
            f"A ranking needs {_TASKS} tasks and {_METHODS} methods with scores on all of them; "
            f"here are {tasks} and {count}.",
            "Run more, or draw 'scores' or 'improvement' instead.",
        )
    means = np.array([[np.mean(seeds) for seeds in scores] for scores in compared.scores.values()]).T
    ranks = average_ranks(means)
    difference = critical_difference(count, tasks, _ALPHA)
    bars = groups(ranks, difference)
    with style():
        chosen = looks(compared.columns, methods)
        figure = _diagram(
            [column.label for column in compared.columns], list(chosen.values()), ranks, difference, bars, width
        )
    return figure.settle(
        caption(
            "Average rank over tasks of each method's mean score, 1 is best. A bar joins methods whose ranks differ by "
            f"less than the critical difference of Nemenyi's test, {difference:.2f} (α = {_ALPHA:.2g} for all pairs).",
            _friedman(friedman_test(means)),
            shared_tasks(compared),
            run_score(table),
            table=table,
        )
    )


def _friedman(p: float | None) -> str:
    if p is None:
        return ""
    said = f"Friedman's test that all methods rank alike: p = {p:.2g}"
    return f"{said}." if p < _ALPHA else f"{said}; it is not rejected, so no difference of ranks is supported."


def _diagram(
    labels: Sequence[str],
    looks_of: Sequence[Look],
    ranks: NDArray[np.float64],
    difference: float,
    bars: Sequence[tuple[int, ...]],
    width: float,
) -> PaperFigure:
    """The diagram, in inches from the upper left corner."""
    shown = [
        f"{wrapped(label, LABEL_SIZE, width / 4.0)}  {rank:.2f}" for label, rank in zip(labels, ranks, strict=True)
    ]
    side = max(text_width(text, LABEL_SIZE) for text in shown) + 2 * _MARGIN
    count = len(ranks)
    line = max(text_height(text, LABEL_SIZE) for text in shown) + _GAP
    first = _AXIS + 0.12 + _BAR * len(bars) + line / 2.0
    half = math.ceil(count / 2)
    order = [int(method) for method in np.argsort(ranks, kind="stable")]
    # Ranks tied across the two sides would meet in one point; half a line keeps them apart.
    lower = line / 2.0 if ranks[order[half]] - ranks[order[half - 1]] < 0.25 else 0.0
    figure = PaperFigure(width, first + (half - 0.5) * line + lower + _MARGIN, layout=None)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, width)
    axes.set_ylim(figure.get_figheight(), 0.0)
    axes.set_axis_off()
    # A difference larger than all ranks makes the scale shorter, so that its bracket fits.
    longest = max(count - 1.0, difference)

    def at(rank: float) -> float:
        return side + (rank - 1.0) / longest * (width - 2.0 * side)

    _scale(axes, at, count, difference)
    for level, members in enumerate(bars):
        ends = ranks[list(members)]
        height = _AXIS + 0.12 + level * _BAR
        axes.plot(
            [at(ends.min()) - 0.03, at(ends.max()) + 0.03],
            [height] * 2,
            color=INK,
            linewidth=2.5,
            solid_capstyle="butt",
        )
    for place, method in enumerate(order):
        left = place < half
        height = first + place * line if left else first + lower + (count - 1 - place) * line
        end = side - _MARGIN / 2.0 if left else at(float(count)) + _MARGIN / 2.0
        _method(axes, at(float(ranks[method])), end, height, shown[method], looks_of[method])
    return figure


def _method(axes: Axes, position: float, end: float, height: float, text: str, look: Look) -> None:
    """One method: a line from the axis at `position` down to `height`, and aside to its name at `end`."""
    axes.plot([position, position, end], [_AXIS, height, height], color=INK, linewidth=0.6, zorder=1)
    # The marker is where the line bends, not on the axis, where tied methods would hide each other.
    axes.plot(
        [position],
        [height],
        color=look.colour,
        marker=look.marker,
        markersize=5.0,
        markeredgecolor=INK,
        markeredgewidth=0.4,
        zorder=3,
    )
    aside = -_MARGIN / 2.0 if end < position else _MARGIN / 2.0
    axes.text(end + aside, height, text, ha="right" if aside < 0.0 else "left", va="center")


def _scale(axes: Axes, at: Callable[[float], float], count: int, difference: float) -> None:
    """The axis of ranks, and above it the length of the critical difference."""
    axes.plot([at(1.0), at(float(count))], [_AXIS] * 2, color=INK, linewidth=0.8, zorder=1)
    for rank in range(1, count + 1):
        axes.plot([at(rank)] * 2, [_AXIS - 0.05, _AXIS], color=INK, linewidth=0.8, zorder=1)
        axes.text(at(rank), _AXIS - 0.07, str(rank), ha="center", va="bottom", fontsize=SMALL_SIZE)
    start, end = at(1.0), at(1.0 + difference)
    axes.plot(
        [start, start, end, end], [_BRACKET + 0.03, _BRACKET, _BRACKET, _BRACKET + 0.03], color=INK, linewidth=0.8
    )
    axes.text(
        start, _BRACKET - 0.02, f"critical difference {difference:.2f}", ha="left", va="bottom", fontsize=SMALL_SIZE
    )
