"""The field of actions over the workspace: what each method commands where, and where it commands nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, PowerNorm
from numpy.typing import NDArray

from lfobench.contract.scene import Scene
from lfobench.render.plots.captions import caption
from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.grid import legend
from lfobench.render.plots.scene.panels import BAR_INCHES, Panel, around, colour_bar, table_panels
from lfobench.render.plots.scene.seen import Points, whose
from lfobench.render.plots.scene.top_view import draw_table, scene_handles
from lfobench.render.plots.style import INK, WIDTHS, style
from lfobench.render.table import Table

_SPACING = 0.01
"""Metres between two points at which a method is asked."""

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
    """Where in the workspace a method is asked: positions ``[n_y, n_x, 2]`` in metres."""
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
        figure, axes = table_panels(panels, width, around(scenes, []), narrowest, BAR_INCHES)
        for cell, panel in zip(axes, panels, strict=True):
            draw_table(cell, panel.scene)
            _draw(cell, panel, norm, long, every)
        colour_bar(figure, axes, norm, _SPEEDS, "commanded motion (cm)", beyond=lengths.max() > long)
        legend(figure, {}, scene_handles(scenes))
    return figure.settle(
        caption(
            "Field of actions from above: by how much, and where to, each method commands the end-effector to move. "
            "All arrows are to one scale; the ground is dark where they vanish.",
            whose(table),
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
