"""Paths of the end-effector from above: demonstrations, and the episodes of each method."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, ListedColormap, Normalize, PowerNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from lfobench.contract.suite import Scene
from lfobench.plots.captions import caption
from lfobench.plots.figure import INK, PAPER, REFERENCE_GREY, WIDTHS, Look, PaperFigure, legend, style
from lfobench.plots.scene import (
    BAR_INCHES,
    Episode,
    Panel,
    Points,
    colour_bar,
    disc_handle,
    draw_table,
    limits_around,
    outcome_looks,
    policies_shown,
    scene_handles,
    table_panels,
    titles,
    whole_table,
)
from lfobench.record import SUCCESS
from lfobench.tables.table import Table

_MOST_POINTS = 2_500
"""Points of demonstrations in one panel; more are unreadable, and a large file."""


@dataclass(frozen=True)
class Demonstrated(Panel):
    """Panel of demonstrations.

    Attributes:
        lines: ``[T, 2]`` through successive observed positions, in metres; a single transition is a short line.
    """

    lines: Sequence[Points]


@dataclass(frozen=True)
class RolledOut(Panel):
    """Panel of one method's episodes."""

    episodes: Sequence[Episode]

    @property
    def detail(self) -> str:
        """Successes out of episodes."""
        successes = sum(episode.outcome == SUCCESS for episode in self.episodes)
        return f"{successes}/{len(self.episodes)}"


def paths(
    panels: Sequence[Demonstrated | RolledOut],
    table: Table,
    width: float = WIDTHS["column"],
    outcomes: Iterable[str] = (),
) -> PaperFigure:
    """One panel of the table per demonstration or method; the marker at the end of a path is its outcome.

    Args:
        panels: in reading order.
        table: of the runs that are drawn, for the caption.
        width: inches.
        outcomes: known ones, whether or not they are shown: figures that know the same ones have the same colours.
    """
    rolled_out = [panel for panel in panels if isinstance(panel, RolledOut)]
    shown = {episode.outcome for panel in rolled_out for episode in panel.episodes}
    looks = outcome_looks([*shown, *outcomes])
    scenes = [panel.scene for panel in panels]
    with style():
        figure, axes = table_panels(panels, width, limits_around(scenes, _all_points(panels)))
        for cell, panel in zip(axes, panels, strict=True):
            draw_table(cell, panel.scene)
            if isinstance(panel, RolledOut):
                for episode in panel.episodes:
                    _draw_episode(cell, episode, looks[episode.outcome])
                    _draw_puck(cell, episode, panel.scene.puck_radius, looks[episode.outcome])
            else:
                cell.add_collection(LineCollection(_shown(panel), colors=INK, linewidths=0.6, alpha=0.6, zorder=1.0))
        handles = [(_handle(each), name) for name, each in looks.items() if name in shown]
        legend(figure, {}, [*handles, *scene_handles(scenes)])
    return figure.settle(
        caption(
            "Paths of the end-effector from above; every circle is where an episode starts, the marker how it ended, "
            "and the number how many of them succeeded.",
            "A dotted ring is where its centre would touch what it must avoid."
            if any(disc.role == "obstacle" for scene in scenes for disc in scene.discs)
            else "",
            "A ring of its size is where the puck then was." if any(scene.puck_radius for scene in scenes) else "",
            policies_shown(table),
            *_outcome_counts(panels),
            table=table,
        )
    )


def _all_points(panels: Sequence[Demonstrated | RolledOut]) -> list[Points]:
    return [
        points
        for panel in panels
        for points in (
            [episode.effector for episode in panel.episodes] if isinstance(panel, RolledOut) else _shown(panel)
        )
    ]


def _shown(panel: Demonstrated) -> list[Points]:
    """The first lines, up to `_MOST_POINTS`."""
    shown: list[Points] = []
    points = 0
    for line in panel.lines:
        points += len(line)
        if shown and points > _MOST_POINTS:
            break
        shown.append(line)
    return shown


def _draw_episode(axes: Axes, episode: Episode, look: Look) -> None:
    path = episode.effector
    axes.plot(path[:, 0], path[:, 1], color=look.colour, linestyle=look.line, linewidth=0.9, zorder=1.0)
    axes.plot(path[0, 0], path[0, 1], "o", color=REFERENCE_GREY, markersize=2.6, markerfacecolor=PAPER, zorder=1.5)
    axes.plot(
        path[-1, 0],
        path[-1, 1],
        color=look.colour,
        marker=look.marker,
        markersize=4.0,
        markeredgecolor=PAPER,
        markeredgewidth=0.4,
        zorder=2.0,
    )


def _draw_puck(axes: Axes, episode: Episode, radius: float | None, look: Look) -> None:
    if episode.puck is not None and radius is not None:
        place = (float(episode.puck[-1, 0]), float(episode.puck[-1, 1]))
        axes.add_patch(Circle(place, radius, facecolor="none", edgecolor=look.colour, linewidth=0.7, zorder=0.9))


def _handle(look: Look) -> Line2D:
    return Line2D([], [], color=look.colour, linestyle=look.line, marker=look.marker)


def _outcome_counts(panels: Sequence[Demonstrated | RolledOut]) -> Iterator[str]:
    """Outcomes of every panel, the most frequent first; and the demonstrations that are left out."""
    for name, panel in zip(titles(panels), panels, strict=True):
        if isinstance(panel, RolledOut):
            counts = Counter(episode.outcome for episode in panel.episodes)
            yield f"{name}: {', '.join(f'{count} {outcome}' for outcome, count in counts.most_common())}."
        elif (shown := len(_shown(panel))) < len(panel.lines):
            yield f"{name}: the first {shown} of {len(panel.lines)}."


_SPACING = 0.01
"""Spacing of the grid in metres."""

_PANELS = {WIDTHS["column"]: (1.1, 8), WIDTHS["page"]: (1.35, 6)}
"""Inches that a panel needs, and points from one arrow to the next, in figures of at least this width."""

_LONG = 0.95
"""Quantile of the commanded lengths that makes an arrow as long as they are apart, and ends the colour bar."""

# Dark where nothing is commanded, in grey as well.
_SPEEDS = LinearSegmentedColormap.from_list("speeds", ["#3b3054", "#8f86b3", "#d8d5e8", "#ffffff"])


@dataclass(frozen=True)
class Field(Panel):
    """Panel of one method.

    Attributes:
        motions: metres that it commands the end-effector to move, at every point of `field_points`, ``[n_y, n_x, 2]``.
    """

    motions: NDArray[np.floating[Any]]


def field_points(scene: Scene) -> Points:
    """Grid of the workspace: positions ``[n_y, n_x, 2]`` in metres."""
    x, y = (_axis(*extent) for extent in scene.workspace)
    return np.stack(np.meshgrid(x, y), axis=-1)


def field(panels: Sequence[Field], table: Table, width: float = WIDTHS["column"]) -> PaperFigure:
    """One panel of the table per method: arrows along the motions that it commands, on a ground that is dark without.

    Args:
        panels: in reading order.
        table: of the runs that are drawn, for the caption.
        width: inches.
    """
    lengths = np.concatenate([np.linalg.norm(panel.motions, axis=-1).ravel() for panel in panels])
    long = max(float(np.quantile(lengths, _LONG)), 1e-6)
    norm = PowerNorm(0.5, 0.0, 100.0 * long)
    scenes = [panel.scene for panel in panels]
    narrowest, every = _PANELS[max((each for each in _PANELS if each <= width), default=min(_PANELS))]
    with style():
        figure, axes = table_panels(panels, width, limits_around(scenes, []), narrowest, BAR_INCHES)
        for cell, panel in zip(axes, panels, strict=True):
            draw_table(cell, panel.scene)
            _draw(cell, panel, norm, long, every)
        colour_bar(figure, axes, norm, _SPEEDS, "commanded motion (cm)", beyond=lengths.max() > long)
        legend(figure, {}, scene_handles(scenes))
    return figure.settle(
        caption(
            "Field of actions from above: by how much, and where to, each method commands the end-effector to move. "
            "All arrows are to one scale; the ground is dark where they vanish.",
            policies_shown(table),
            table=table,
        )
    )


def _axis(low: float, high: float) -> NDArray[np.float64]:
    return np.linspace(low, high, max(2, round((high - low) / _SPACING) + 1))


def _draw(axes: Axes, panel: Field, norm: PowerNorm, long: float, every: int) -> None:
    points = field_points(panel.scene)
    lengths = 100.0 * np.linalg.norm(panel.motions, axis=-1)
    axes.pcolormesh(
        points[0, :, 0],
        points[:, 0, 1],
        lengths,
        norm=norm,
        cmap=_SPEEDS,
        shading="gouraud",
        rasterized=True,
        zorder=0.2,
    )
    chosen = tuple(slice((size - 1) % every // 2, None, every) for size in lengths.shape)
    place, command = points[chosen], panel.motions[chosen]
    axes.quiver(
        place[..., 0],
        place[..., 1],
        command[..., 0],
        command[..., 1],
        angles="xy",
        scale_units="xy",
        # A long arrow reaches the next one.
        scale=long / (every * _SPACING),
        units="inches",
        width=0.008,
        headwidth=3.5,
        headlength=4.0,
        headaxislength=3.5,
        minlength=0.5,
        color=INK,
        zorder=1.0,
    )


_SHOWN = 8
"""About so many moments of an episode are drawn as discs."""


@dataclass(frozen=True)
class Hit(Panel):
    """Panel of one episode with a puck."""

    episode: Episode

    @property
    def detail(self) -> str:
        """Its outcome."""
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
            _draw_hit(cell, panel, colours, norm, every)
        colour_bar(figure, axes, norm, colours, "time (s)")
        kinds = [(disc_handle(INK), "puck"), (disc_handle(PAPER), "end-effector")]
        legend(figure, {}, [*kinds, *scene_handles(scenes)])
    return figure.settle(
        caption(
            f"Episodes from above, shaded by time: the puck (filled) and the end-effector (rings) every {every:g} s "
            "and at the end, to scale, and their paths between; a title says how the episode ended.",
            policies_shown(table),
            table=table,
        )
    )


def _times() -> Colormap:
    """Dark to light with time; without the lightest end, which would vanish on the table."""
    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.93, 256)))


def _interval(seconds: float) -> float:
    """Round seconds between two moments that are drawn."""
    return next((each for each in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if seconds / each <= _SHOWN), 10.0)


def _draw_hit(axes: Axes, panel: Hit, colours: Colormap, norm: Normalize, every: float) -> None:
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
