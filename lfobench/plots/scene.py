"""Panels of tables from above: their grid, limits, titles and what is on the table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from lfobench.contract.suite import Disc, Scene
from lfobench.plots.captions import run_cells
from lfobench.plots.figure import INK, LABEL_SIZE, PAPER, REFERENCE_GREY, Look, PaperFigure, look, text_height, wrapped
from lfobench.record import SUCCESS
from lfobench.tables.table import Table

Points = NDArray[np.floating[Any]]
"""Positions ``[T, 2]`` in metres."""


class Episode(Protocol):
    """An episode of T steps from above: positions ``[T + 1, 2]`` in metres."""

    @property
    def start(self) -> int:
        """Number of the fixed start."""
        ...

    @property
    def step_seconds(self) -> float:
        """Seconds of a step."""
        ...

    @property
    def effector(self) -> Points:
        """Positions of the end-effector."""
        ...

    @property
    def puck(self) -> Points | None:
        """Positions of the puck, where there is one."""
        ...

    @property
    def outcome(self) -> str:
        """Its end, named by the environment."""
        ...


# Vermilion first, the other blue late; these seven differ in grey from each other and from a success.
_FAILURES = (4, 1, 3, 5, 2, 6, 14)
_ROUND = 16


def outcome_looks(outcomes: Iterable[str]) -> dict[str, Look]:
    """One look per outcome: success first, then the failures by name."""
    failures = sorted(set(outcomes) - {SUCCESS})
    slots = [_ROUND * (index // len(_FAILURES)) + _FAILURES[index % len(_FAILURES)] for index in range(len(failures))]
    return {SUCCESS: look(0)} | {name: look(slot) for name, slot in zip(failures, slots, strict=True)}


def policies_shown(table: Table) -> str:
    """Seeds of the policies that a picture shows, for its caption."""
    seeds = sorted({seed for _, row in table.rows() for cell in run_cells(table, row).values() for seed in cell.seeds})
    return f"Policies at the end of training, seed {', '.join(map(str, seeds))}."


BAR_INCHES = 0.6
"""Width of a colour bar at the right."""

_PANEL_INCHES = 1.35
"""A narrower panel would be hard to read."""

_LABELS_INCHES = 0.45
_MARGIN = 0.02

Limits = tuple[float, float, float, float]
"""Limits of a panel: lowest and highest x, lowest and highest y, in metres."""


def whole_table(scene: Scene) -> Limits:
    """The whole table, and a margin."""
    return scene.x[0] - _MARGIN, scene.x[1] + _MARGIN, scene.y[0] - _MARGIN, scene.y[1] + _MARGIN


def limits_around(scenes: Iterable[Scene], points: Iterable[Points]) -> Limits:
    """The part of the tables that holds all workspaces, discs and `points`, and the full breadth."""
    lengths = []
    for scene in scenes:
        lengths += [*scene.workspace[0], *(disc.center[0] - disc.radius for disc in scene.discs)]
        lengths += [disc.center[0] + disc.radius for disc in scene.discs]
    breadths = [end for scene in scenes for end in scene.y]
    for path in points:
        lengths += [float(np.min(path[:, 0])), float(np.max(path[:, 0]))]
    reach = max(max(scene.effector_radius, scene.puck_radius or 0.0) for scene in scenes) + _MARGIN
    low = max(min(lengths) - reach, min(scene.x[0] for scene in scenes) - _MARGIN)
    high = min(max(lengths) + reach, max(scene.x[1] for scene in scenes) + _MARGIN)
    return low, high, min(breadths) - _MARGIN, max(breadths) + _MARGIN


@dataclass(frozen=True)
class Panel:
    """One table.

    Attributes:
        task: panels of a task follow each other and begin a row of their own.
        label: a method, for example.
        scene: the table.
    """

    task: str
    label: str
    scene: Scene

    @property
    def detail(self) -> str:
        """Text in its title after task and label."""
        return ""


def titles(panels: Sequence[Panel]) -> list[str]:
    """Titles of the panels; the task is part of them where there are several."""
    several = len({panel.task for panel in panels}) > 1
    return [f"{panel.task} {panel.label}" if several else panel.label for panel in panels]


def table_panels(
    panels: Sequence[Panel], width: float, limits: Limits, narrowest: float = _PANEL_INCHES, bar_inches: float = 0.0
) -> tuple[PaperFigure, list[Axes]]:
    """A figure of `width` inches with axes of these limits for every panel, row by row.

    Args:
        panels: in reading order.
        width: inches.
        limits: of every panel.
        narrowest: inches that a panel needs.
        bar_inches: inches that are left to a colour bar at the right.
    """
    available = width - _LABELS_INCHES - bar_inches
    aspect = (limits[3] - limits[2]) / (limits[1] - limits[0])
    blocks = [len(list(block)) for _, block in groupby(panels, lambda panel: panel.task)]
    across = min(max(blocks), max(1, int(available / narrowest)))
    across = math.ceil(max(blocks) / math.ceil(max(blocks) / across))
    inches = available / across
    headings = [
        wrapped(f"{name}: {panel.detail}" if panel.detail else name, LABEL_SIZE, inches - 0.1)
        for name, panel in zip(titles(panels), panels, strict=True)
    ]
    title_height = max(text_height(heading, LABEL_SIZE) for heading in headings) + 0.06
    down = sum(math.ceil(block / across) for block in blocks)
    figure = PaperFigure(width, down * (inches * aspect + title_height) + _LABELS_INCHES)
    grid = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    used: list[Axes] = []
    row = 0
    for block in blocks:
        rows = math.ceil(block / across)
        cells: list[Axes] = list(grid[row : row + rows].flat)
        used += cells[:block]
        for axes in cells[block:]:
            axes.remove()
        row += rows
    for axes, heading in zip(used, headings, strict=True):
        axes.set_title(heading)
        axes.set_xlim(limits[0], limits[1])
        axes.set_ylim(limits[2], limits[3])
        axes.set_aspect("equal", adjustable="box")
        axes.spines[:].set_visible(False)
        axes.set_xticks(_ticks(limits[0], limits[1]))
        axes.set_yticks(_ticks(limits[2], limits[3]))
    for column in grid.T:
        lowest = [axes for axes in column if axes in used][-1]
        lowest.tick_params(labelbottom=True)
    figure.supxlabel("x along the table (m)")
    figure.supylabel("y across (m)")
    return figure, used


def _ticks(low: float, high: float) -> list[float]:
    """Round metres inside the limits, so far apart that their labels do not touch."""
    step = 0.2 if high - low < 0.7 else 0.3 if high - low < 1.0 else 0.5
    first = math.ceil((low + _MARGIN) / step)
    return [step * index for index in range(first, math.floor((high - _MARGIN) / step) + 1)]


def colour_bar(
    figure: PaperFigure, axes: Sequence[Axes], norm: Normalize, colours: Colormap, label: str, beyond: bool = False
) -> None:
    """A bar at the right of all panels, in the space that `table_panels` left; `beyond`: values exceed its end."""
    extend = "max" if beyond else "neither"
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=axes, extend=extend, aspect=30.0, pad=0.02, shrink=0.9, label=label
    )
    bar.outline.set_linewidth(0.6)


TABLE, WORKSPACE, OBSTACLE, GOAL = "#eceff1", "#fbfcfc", "#6f6f6f", "#bfe3d0"

_EDGE, _ARROW = 0.06, 0.1
"""Metres at the upper edge of the table that the arrow takes where the workspace leaves less; half of its length."""


def draw_table(axes: Axes, scene: Scene, downhill: str = "") -> None:
    """The table, the workspace, the discs on it, and an arrow downhill, which may have a name."""
    axes.add_patch(_rectangle(scene.x, scene.y, facecolor=TABLE, edgecolor=INK, linewidth=0.8, zorder=0.0))
    axes.add_patch(
        _rectangle(*scene.workspace, facecolor=WORKSPACE, edgecolor=REFERENCE_GREY, linewidth=0.5, zorder=0.1)
    )
    for disc in scene.discs:
        _draw_disc(axes, disc, scene.effector_radius)
    # Along the upper edge, where paths are rare.
    height = (scene.y[1] + max(scene.workspace[1][1], scene.y[1] - _EDGE)) / 2.0
    middle = (max(scene.x[0], axes.get_xlim()[0]) + min(scene.x[1], axes.get_xlim()[1])) / 2.0
    low, high = (middle + scene.downhill * _ARROW, height), (middle - scene.downhill * _ARROW, height)
    shape = {"arrowstyle": "->", "color": REFERENCE_GREY, "linewidth": 0.8, "shrinkA": 0.0, "shrinkB": 0.0}
    alignment = "left" if scene.downhill < 0 else "right"
    axes.annotate(downhill, low, high, arrowprops=shape, color=REFERENCE_GREY, va="center", ha=alignment, zorder=0.6)


def scene_handles(scenes: Sequence[Scene]) -> list[tuple[Line2D, str]]:
    """The legend's entries for what `draw_table` draws."""
    discs = {disc.name: disc for scene in scenes for disc in scene.discs}
    arrow = Line2D([], [], color=REFERENCE_GREY, linewidth=0.8, marker="<" if scenes[0].downhill < 0 else ">")
    return [(disc_handle(_fill(disc)), name) for name, disc in discs.items()] + [(arrow, "downhill")]


def disc_handle(fill: str) -> Line2D:
    """The legend's entry for something round."""
    return Line2D(
        [], [], linestyle="none", marker="o", markersize=6.0, markeredgewidth=0.6, color=fill, markeredgecolor=INK
    )


def _fill(disc: Disc) -> str:
    return OBSTACLE if disc.role == "obstacle" else GOAL


def _rectangle(x: tuple[float, float], y: tuple[float, float], **look: object) -> Rectangle:
    return Rectangle((x[0], y[0]), x[1] - x[0], y[1] - y[0], **look)  # type: ignore[arg-type]


def _draw_disc(axes: Axes, disc: Disc, effector_radius: float) -> None:
    axes.add_patch(Circle(disc.center, disc.radius, facecolor=_fill(disc), edgecolor=INK, linewidth=0.6, zorder=0.5))
    if disc.role == "obstacle":
        # Where the centre of the end-effector would touch it: a path is that of the centre.
        axes.add_patch(
            Circle(
                disc.center,
                disc.radius + effector_radius,
                facecolor="none",
                edgecolor=OBSTACLE,
                linewidth=0.6,
                linestyle=(0.0, (1.0, 1.5)),
                zorder=0.5,
            )
        )
    else:
        axes.add_patch(
            Circle(disc.center, 0.55 * disc.radius, facecolor=PAPER, edgecolor=INK, linewidth=0.4, zorder=0.5)
        )
