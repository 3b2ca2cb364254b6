"""A table seen from above: what stands on it and which way is down."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from lfobench.contract.scene import Disc, Scene
from lfobench.render.plots.style import INK, PAPER, REFERENCE_GREY

TABLE, WORKSPACE, OBSTACLE, GOAL = "#eceff1", "#fbfcfc", "#6f6f6f", "#bfe3d0"

_EDGE, _ARROW = 0.06, 0.1
"""Metres at the upper edge of the table that the arrow takes where the workspace leaves less; half of its length."""


def draw_table(axes: Axes, scene: Scene, downhill: str = "") -> None:
    """The table, the workspace, what stands on it, and an arrow downhill, which may have a name."""
    axes.add_patch(_rectangle(scene.x, scene.y, facecolor=TABLE, edgecolor=INK, linewidth=0.8, zorder=0.0))
    axes.add_patch(
        _rectangle(*scene.workspace, facecolor=WORKSPACE, edgecolor=REFERENCE_GREY, linewidth=0.5, zorder=0.1)
    )
    for disc in scene.discs:
        _draw_disc(axes, disc, scene.effector_radius)
    # Along the upper edge, where least happens.
    height = (scene.y[1] + max(scene.workspace[1][1], scene.y[1] - _EDGE)) / 2.0
    middle = (max(scene.x[0], axes.get_xlim()[0]) + min(scene.x[1], axes.get_xlim()[1])) / 2.0
    low, high = (middle + scene.downhill * _ARROW, height), (middle - scene.downhill * _ARROW, height)
    shape = {"arrowstyle": "->", "color": REFERENCE_GREY, "linewidth": 0.8, "shrinkA": 0.0, "shrinkB": 0.0}
    side = "left" if scene.downhill < 0 else "right"
    axes.annotate(downhill, low, high, arrowprops=shape, color=REFERENCE_GREY, va="center", ha=side, zorder=0.6)


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
