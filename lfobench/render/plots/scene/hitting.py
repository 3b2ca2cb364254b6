"""A hit from above: end-effector and puck, shaded by time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.patches import Circle

from lfobench.render.plots.captions import caption
from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.grid import legend
from lfobench.render.plots.scene.panels import BAR_INCHES, Panel, colour_bar, table_panels, whole_table
from lfobench.render.plots.scene.seen import Points, Seen, whose
from lfobench.render.plots.scene.top_view import disc_handle, draw_table, scene_handles
from lfobench.render.plots.style import INK, PAPER, WIDTHS, style
from lfobench.render.table import Table

_SHOWN = 8
"""About so many moments of an episode are drawn as discs."""


@dataclass(frozen=True)
class Hit(Panel):
    """Panel of one episode with a puck."""

    episode: Seen

    @property
    def told(self) -> str:
        """How it ended."""
        return self.episode.outcome


def hitting(panels: Sequence[Hit], table: Table, width: float = WIDTHS["column"]) -> PaperFigure:
    """One panel of the table per episode: the puck as filled discs, the end-effector as rings, both shaded by time.

    Args:
        panels: in reading order.
        table: of the runs that are drawn, for the caption.
        width: inches.
    """
    seconds = max(panel.episode.step_seconds * (len(panel.episode.effector) - 1) for panel in panels)
    norm = Normalize(0.0, max(seconds, 1e-6))
    views = np.array([whole_table(panel.scene) for panel in panels])
    limits = (views[:, 0].min(), views[:, 1].max(), views[:, 2].min(), views[:, 3].max())
    scenes = [panel.scene for panel in panels]
    with style():
        colours = _times()
        figure, axes = table_panels(panels, width, limits, 2.4, BAR_INCHES)
        every = _interval(seconds)
        for cell, panel in zip(axes, panels, strict=True):
            draw_table(cell, panel.scene)
            _draw(cell, panel, colours, norm, every)
        colour_bar(figure, axes, norm, colours, "time (s)")
        kinds = [(disc_handle(INK), "puck"), (disc_handle(PAPER), "end-effector")]
        legend(figure, {}, [*kinds, *scene_handles(scenes)])
    return figure.settle(
        caption(
            f"Episodes from above, shaded by time: the puck (filled) and the end-effector (rings) every {every:g} s "
            "and at the end, to scale, and their paths between; a title says how the episode ended.",
            whose(table),
            table=table,
        )
    )


def _times() -> Colormap:
    """Dark to light with time; without the lightest end, which would vanish on the table."""
    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.93, 256)))


def _interval(seconds: float) -> float:
    """Round seconds between two moments that are drawn."""
    return next((each for each in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if seconds / each <= _SHOWN), 10.0)


def _draw(axes: Axes, panel: Hit, colours: Colormap, norm: Normalize, every: float) -> None:
    episode = panel.episode
    assert episode.puck is not None and panel.scene.puck_radius is not None
    times = episode.step_seconds * np.arange(len(episode.effector))
    stride = max(1, round(every / episode.step_seconds))
    moments = sorted({*range(0, len(times), stride), len(times) - 1})
    axes.add_collection(_line(episode.effector, times, colours, norm, 0.8))
    axes.add_collection(_line(episode.puck, times, colours, norm, 1.6))
    for moment in moments:
        colour = colours(norm(times[moment]))
        axes.add_patch(
            Circle(
                tuple(episode.effector[moment]),
                panel.scene.effector_radius,
                facecolor="none",
                edgecolor=colour,
                linewidth=1.1,
                zorder=1.2,
            )
        )
        axes.add_patch(
            Circle(
                tuple(episode.puck[moment]),
                panel.scene.puck_radius,
                facecolor=colour,
                edgecolor=PAPER,
                linewidth=0.3,
                zorder=1.4,
            )
        )


def _line(path: Points, times: Points, colours: Colormap, norm: Normalize, width: float) -> LineCollection:
    steps = LineCollection(
        np.stack([path[:-1], path[1:]], axis=1), cmap=colours, norm=norm, linewidths=width, zorder=1.1
    )
    steps.set_array(times[1:])
    return steps
