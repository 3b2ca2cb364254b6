"""Learning curves: mean score over seeds against gradient steps, one panel per task."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, MaxNLocator

from lfobench.plots.captions import (
    DEMONSTRATION,
    LEVEL,
    caption,
    demonstration_score,
    fewer_starts,
    references,
    run_columns,
    score_label,
    score_sentence,
)
from lfobench.plots.figure import (
    INK,
    REFERENCE_GREY,
    WIDTHS,
    Look,
    PaperFigure,
    demonstration_handle,
    legend,
    looks,
    panels,
    reference_lines,
    score_limits,
    style,
)
from lfobench.record import Record
from lfobench.score import Statistic
from lfobench.stats.intervals import Interval, summarize, t_interval
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.table import Column, Table

DIVERGED_SCORE = 0.0
"""Score of a seed from its divergence on, as in a table."""


@dataclass(frozen=True)
class Curve:
    """Scores of one method on one task.

    Attributes:
        steps: gradient steps ``[T]`` of the evaluations.
        seeds: the scores of each seed, ``[n][T]``; None where it was not evaluated.
        means: over the seeds with a score, ``[T]``.
        intervals: t-intervals of the means, ``[T]``; None where fewer than two seeds have a score.
        diverged: steps at which seeds diverged.
    """

    steps: list[int]
    seeds: list[list[float | None]]
    means: list[float]
    intervals: list[Interval | None]
    diverged: list[int]


def evaluated(records: Sequence[Record]) -> list[int]:
    """The steps at which any of `records` was evaluated, ascending."""
    return sorted({evaluation.step for record in records for evaluation in record.evaluations})


def learning_curve(records: Sequence[Record], steps: Sequence[int], statistic: Statistic) -> Curve | None:
    """The curve of one cell's `records` over its task's evaluation `steps`; None where it has no score at any.

    Of every evaluation it shows the success rate where `statistic` counts successes, else the mean normalised score.
    """
    seeds = {record.seed: _scores(record, steps, statistic) for record in records}
    kept, means, intervals = [], [], []
    for index in range(len(steps)):
        found = [score for scores in seeds.values() if (score := scores[index]) is not None]
        if found:
            summary = summarize(found)
            kept.append(index)
            means.append(summary.mean)
            intervals.append(t_interval(summary, LEVEL))
    if not kept:
        return None
    return Curve(
        [steps[index] for index in kept],
        [[scores[index] for index in kept] for scores in seeds.values()],
        means,
        intervals,
        [_end(record) for record in records if record.status == "diverged"],
    )


def _scores(record: Record, steps: Sequence[int], statistic: Statistic) -> list[float | None]:
    measured: dict[int, float] = dict(record.curve(statistic))
    if record.status != "diverged":
        return [measured.get(step) for step in steps]
    end = _end(record)
    return [measured.get(step) if step < end else DIVERGED_SCORE for step in steps]


def _end(record: Record) -> int:
    """The step of divergence; where the record does not say, the last evaluation's, or the start."""
    if record.diverged_at is not None:
        return record.diverged_at
    return max((evaluation.step for evaluation in record.evaluations), default=0)


_BAND_FROM = 3
"""Seeds from which on a band is drawn; of fewer, every seed is a thin line."""

_PANEL_HEIGHT = 1.1

_CROSS: dict[str, Any] = {
    "marker": "X",
    "linestyle": "none",
    "markersize": 5.0,
    "markeredgecolor": INK,
    "markeredgewidth": 0.5,
}

Panel = dict[Column, Curve]


def curves(
    table: Table, records: Sequence[Record], width: float = WIDTHS["column"], methods: Sequence[str] = ()
) -> PaperFigure:
    """One panel per task of `table`; a line per method with the t-interval of the mean as a band.

    Args:
        table: made of `records`.
        records: with the evaluations.
        width: inches.
        methods: names in the order in which colours are handed out, see `style.looks`.
    """
    columns = run_columns(table)
    rows = [row for _, row in table.rows()]
    found = [_panel(columns, records, row.task, table.statistic) for row in rows]
    shown = [curve for panel in found for curve in panel.values()]
    demonstrations = [demonstration_score(table, row) for row in rows]
    known = [score for score in demonstrations if score is not None]
    ends = [end for curve in shown for end in _ends(curve)]
    limits = score_limits([*(mean for curve in shown for mean in curve.means), *_single(shown), *known], ends)
    diverged = any(curve.diverged for curve in shown)
    with style():
        alike = len({(curve.steps[0], curve.steps[-1]) for curve in shown}) == 1
        figure, axes = panels([row.task for row in rows], width, _PANEL_HEIGHT, share_x=alike)
        chosen = looks(columns, methods)
        for panel, of_panel, demonstration in zip(axes, found, demonstrations, strict=True):
            reference_lines(panel, "y", demonstration)
            for place, (column, curve) in enumerate(of_panel.items()):
                _draw(panel, curve, chosen[column], place / len(columns))
            panel.set_ylim(*limits)
            panel.xaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
            panel.xaxis.set_major_formatter(EngFormatter(sep=""))
        figure.supxlabel("gradient steps")
        figure.supylabel(score_label(table))
        others = [demonstration_handle()] if known else []
        if diverged:
            others.append((Line2D([], [], color=REFERENCE_GREY, **_CROSS), "a seed diverged"))
        legend(figure, chosen, others)
    cut = any(not limits[0] <= end <= limits[1] for end in ends)
    return figure.settle(
        caption(
            "Learning curves: the score of each evaluation, mean over seeds.",
            f"Bands: {LEVEL:.0%} t-intervals of the mean at each step{', cut by the axis' if cut else ''}.",
            f"Of fewer than {_BAND_FROM} seeds each is a thin line." if any(map(_few, shown)) else "",
            f"A cross marks the step of a divergence, from which on the seed counts as {DIVERGED_SCORE:.0f}."
            if diverged
            else "",
            f"{score_sentence(table)}. {references(table)}",
            fewer_starts(table, records),
            DEMONSTRATION if known else "",
            table=table,
        )
    )


def _panel(columns: Sequence[Column], records: Sequence[Record], task: str, statistic: Statistic) -> Panel:
    on_task = {
        column: [record for record in members if record.task == task]
        for column, members in arrange_columns(records).items()
    }
    steps = evaluated([record for members in on_task.values() for record in members])
    curves_found = {column: learning_curve(on_task.get(column, []), steps, statistic) for column in columns}
    return {column: curve for column, curve in curves_found.items() if curve is not None}


def _few(curve: Curve) -> bool:
    return len(curve.seeds) < _BAND_FROM


def _ends(curve: Curve) -> Iterator[float]:
    """Ends of the intervals that are drawn."""
    if not _few(curve):
        for interval in curve.intervals:
            if interval is not None:
                yield from (interval.low, interval.high)


def _single(shown: Sequence[Curve]) -> Iterator[float]:
    """Scores of the seeds that are drawn one by one."""
    for curve in shown:
        if _few(curve):
            yield from (score for seed in curve.seeds for score in seed if score is not None)


def _draw(axes: Axes, curve: Curve, look: Look, offset: float) -> None:
    # Markers of different methods lie at different places, or they would hide each other where curves meet.
    axes.plot(
        curve.steps,
        curve.means,
        color=look.colour,
        linestyle=look.line,
        marker=look.marker,
        markevery=(0.25 * offset, 0.25) if len(curve.steps) > 1 else None,
    )
    if _few(curve):
        for seed in curve.seeds if len(curve.seeds) > 1 else []:
            scores = [float("nan") if score is None else score for score in seed]
            axes.plot(curve.steps, scores, color=look.colour, linestyle=look.line, linewidth=0.5)
    else:
        banded = [(step, each) for step, each in zip(curve.steps, curve.intervals, strict=True) if each is not None]
        axes.fill_between(
            [step for step, _ in banded],
            [interval.low for _, interval in banded],
            [interval.high for _, interval in banded],
            color=look.colour,
            alpha=0.2,
            linewidth=0.0,
        )
    for step in curve.diverged:
        axes.plot([step], [DIVERGED_SCORE], color=look.colour, zorder=3, clip_on=False, **_CROSS)
