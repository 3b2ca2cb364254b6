"""Probability of improvement: how often a run of one method beats a run of another, for every pair of methods.

R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare, "Deep reinforcement learning at the edge of
the statistical precipice", NeurIPS 2021, section 4.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

from lfobench.errors import UserError
from lfobench.plots.captions import (
    DEMONSTRATION,
    LEVEL,
    caption,
    compare,
    demonstration_score,
    references,
    run_cells,
    run_columns,
    run_score,
    score_label,
    shared_tasks,
)
from lfobench.plots.figure import (
    EXPERT,
    INK,
    LABEL_SIZE,
    PAPER,
    RANDOM,
    SMALL_SIZE,
    WIDTHS,
    Look,
    PaperFigure,
    legend,
    looks,
    one_line,
    panels,
    reference_lines,
    score_limits,
    style,
    text_height,
    text_width,
    wrapped,
)
from lfobench.stats.aggregates import REPLICATES, Profile, performance_profile, probability_of_improvement
from lfobench.stats.intervals import Estimate, Interval, t_interval
from lfobench.stats.ranking import average_ranks, critical_difference, friedman_test, groups
from lfobench.tables.table import FAILED, MISSING, Cell, Table

# Blue is darker than orange, so that the two ends differ in grey as well; both leave black text readable.
MAP = LinearSegmentedColormap.from_list("improvement", ["#F2C14E", "#FAFAFA", "#4296CC"])
_DIAGONAL = "#d0d0d0"
_CELL_HEIGHT = 0.36
_EDGES = 0.2
"""Inches of the width that are neither cells nor names."""


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
        raise UserError("A probability of improvement needs two methods; there is one.", "Run another.")
    found: dict[tuple[int, int], Estimate] = {}
    for first, second in combinations(range(len(columns)), 2):
        estimate = probability_of_improvement(compared.scores[columns[first]], compared.scores[columns[second]], LEVEL)
        found[first, second], found[second, first] = estimate, _swapped(estimate)
    with style():
        rows = [wrapped(column.label, LABEL_SIZE, width / 4.0) for column in columns]
        across = (width - max(text_width(label, LABEL_SIZE) for label in rows) - _EDGES) / len(columns)
        upright = max(text_width(one_line(column.label), LABEL_SIZE) for column in columns) > across
        # An upright heading has the room that its cell is wide; the rows have the same names in the same order.
        lines = max(1, int(across / text_height("", LABEL_SIZE)))
        heads = [
            wrapped(column.label, LABEL_SIZE, width / 4.0, lines) if upright else one_line(column.label)
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


_HEIGHT = 1.9

_REPLICATES = 10_000
"""A fifth of what a printed interval gets: no eye sees the difference in a band."""


def profiles(table: Table, width: float = WIDTHS["column"], methods: Sequence[str] = ()) -> PaperFigure:
    """A descending line per method of `table`, with a pointwise band; a higher line is better.

    Args:
        table: with the scores.
        width: inches.
        methods: names in the order in which colours are handed out, see `style.looks`.

    Raises:
        UserError: the methods share no task.
    """
    compared = compare(table)
    counted = [score for tasks in compared.scores.values() for task in tasks for score in task]
    low, high = min(RANDOM, *counted), max(EXPERT, *counted)
    margin = 0.03 * (high - low)
    # A profile is a step function that changes at the scores.
    found = {
        column: performance_profile(
            tasks, [low - margin, *np.unique(np.concatenate(tasks)), high + margin], LEVEL, _REPLICATES
        )
        for column, tasks in compared.scores.items()
    }
    with style():
        figure = PaperFigure(width, _HEIGHT)
        axes = figure.subplots()
        chosen = looks(compared.columns, methods)
        reference_lines(axes, "x", None)
        for place, (column, profile) in enumerate(found.items()):
            _draw(axes, profile, chosen[column], place / len(found))
        axes.set_xlim(low - margin, high + margin)
        axes.set_ylim(0.0, 1.02)
        axes.set_xlabel(f"{score_label(table)} τ")
        axes.set_ylabel("fraction of runs\nwith score > τ")
        legend(figure, chosen)
    banded = any(profile.low is not None for profile in found.values())
    return figure.settle(
        caption(
            "Performance profiles: the fraction of runs whose score exceeds τ, tasks counted equally.",
            f"Bands: pointwise {LEVEL:.0%} intervals of a bootstrap stratified by task, {_REPLICATES:,} replicates."
            if banded
            else "One run per task shows no spread, so there are no bands.",
            shared_tasks(compared),
            f"{run_score(table)} {references(table)}",
            table=table,
        )
    )


def _draw(axes: Axes, profile: Profile, look: Look, offset: float) -> None:
    axes.plot(
        profile.thresholds,
        profile.values,
        color=look.colour,
        linestyle=look.line,
        drawstyle="steps-post",
        marker=look.marker,
        markevery=(0.2 * offset, 0.2),
    )
    if profile.low is not None and profile.high is not None:
        axes.fill_between(
            profile.thresholds, profile.low, profile.high, step="post", color=look.colour, alpha=0.2, linewidth=0.0
        )


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
    text = f"Friedman's test that all methods rank alike: p = {p:.2g}"
    return f"{text}." if p < _ALPHA else f"{text}; it is not rejected, so no difference of ranks is supported."


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
    margin = max(text_width(text, LABEL_SIZE) for text in shown) + 2 * _MARGIN
    count = len(ranks)
    line = max(text_height(text, LABEL_SIZE) for text in shown) + _GAP
    first = _AXIS + 0.12 + _BAR * len(bars) + line / 2.0
    half = math.ceil(count / 2)
    order = [int(method) for method in np.argsort(ranks, kind="stable")]
    # Ranks tied between the left and the right half would meet in one point; half a line separates them.
    lower = line / 2.0 if ranks[order[half]] - ranks[order[half - 1]] < 0.25 else 0.0
    figure = PaperFigure(width, first + (half - 0.5) * line + lower + _MARGIN, layout=None)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, width)
    axes.set_ylim(figure.get_figheight(), 0.0)
    axes.set_axis_off()
    # A difference larger than all ranks makes the scale shorter, so that its bracket fits.
    longest = max(count - 1.0, difference)

    def at(rank: float) -> float:
        return margin + (rank - 1.0) / longest * (width - 2.0 * margin)

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
        end = margin - _MARGIN / 2.0 if left else at(float(count)) + _MARGIN / 2.0
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
                _draw_scores(panel, row.get(column), line, chosen[column], limits)
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


def _draw_scores(axes: Axes, cell: Cell | None, line: int, look: Look, limits: tuple[float, float]) -> None:
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
