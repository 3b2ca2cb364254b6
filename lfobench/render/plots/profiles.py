"""Performance profiles: the fraction of runs that score above a threshold, for every threshold.

R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare, "Deep reinforcement learning at the edge of
the statistical precipice", NeurIPS 2021, section 4.2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from lfobench.render.plots.captions import caption, references, run_score, score_label, shared_tasks
from lfobench.render.plots.compared import LEVEL, compare
from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.grid import EXPERT, RANDOM, legend, reference_lines
from lfobench.render.plots.style import WIDTHS, Look, looks, style
from lfobench.render.table import Table
from lfobench.stats.aggregates import Profile, performance_profile

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
    # Below a method's lowest score its line is at 1; between two scores it does not change.
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
