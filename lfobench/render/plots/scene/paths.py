"""Paths of the end-effector from above: demonstrations beside the episodes of each method."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from lfobench.contract.record import SUCCESS
from lfobench.render.plots.captions import caption
from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.grid import legend
from lfobench.render.plots.scene.panels import Panel, around, names, table_panels
from lfobench.render.plots.scene.seen import Points, Seen, outcome_looks, whose
from lfobench.render.plots.scene.top_view import draw_table, scene_handles
from lfobench.render.plots.style import INK, PAPER, REFERENCE_GREY, WIDTHS, Look, style
from lfobench.render.table import Table

_MOST_POINTS = 2_500
"""Of demonstrations in one panel; beyond, they are a blot and a large file."""


@dataclass(frozen=True)
class Demonstrated(Panel):
    """Panel of what the methods observe.

    Attributes:
        strokes: lines ``[T, 2]`` through successive observed positions, in metres; one transition is a short one.
    """

    strokes: Sequence[Points]


@dataclass(frozen=True)
class RolledOut(Panel):
    """Panel of one method's episodes."""

    episodes: Sequence[Seen]

    @property
    def told(self) -> str:
        """How many of them succeeded."""
        successes = sum(episode.outcome == SUCCESS for episode in self.episodes)
        return f"{successes}/{len(self.episodes)}"


def paths(
    panels: Sequence[Demonstrated | RolledOut],
    table: Table,
    width: float = WIDTHS["column"],
    outcomes: Iterable[str] = (),
) -> PaperFigure:
    """One panel of the table per demonstration or method; every path ends in a marker that says how.

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
        figure, axes = table_panels(panels, width, around(scenes, _all_points(panels)))
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
            whose(table),
            *_told(panels),
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
    """The first strokes, up to `_MOST_POINTS`."""
    shown: list[Points] = []
    points = 0
    for stroke in panel.strokes:
        points += len(stroke)
        if shown and points > _MOST_POINTS:
            break
        shown.append(stroke)
    return shown


def _draw_episode(axes: Axes, episode: Seen, look: Look) -> None:
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


def _draw_puck(axes: Axes, episode: Seen, radius: float | None, look: Look) -> None:
    if episode.puck is not None and radius is not None:
        place = (float(episode.puck[-1, 0]), float(episode.puck[-1, 1]))
        axes.add_patch(Circle(place, radius, facecolor="none", edgecolor=look.colour, linewidth=0.7, zorder=0.9))


def _handle(look: Look) -> Line2D:
    return Line2D([], [], color=look.colour, linestyle=look.line, marker=look.marker)


def _told(panels: Sequence[Demonstrated | RolledOut]) -> Iterator[str]:
    """How the episodes of every panel ended, the most frequent first; and which demonstrations are left out."""
    for name, panel in zip(names(panels), panels, strict=True):
        if isinstance(panel, RolledOut):
            counts = Counter(episode.outcome for episode in panel.episodes)
            yield f"{name}: {', '.join(f'{count} {outcome}' for outcome, count in counts.most_common())}."
        elif (shown := len(_shown(panel))) < len(panel.strokes):
            yield f"{name}: the first {shown} of {len(panel.strokes)}."
