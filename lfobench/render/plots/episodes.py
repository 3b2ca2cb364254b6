"""Episodes of a data file, one mark each: how long they are and what they return."""

from __future__ import annotations

from lfobench.contract.diagnosis import Diagnosis
from lfobench.render.diagnosis import summary
from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.style import style

MOST_DETAILED = 2_000
"""Marks beyond this number are drawn as an image, so that a .pdf of 45,000 episodes stays small."""


def episodes(found: Diagnosis, name: str, width: float) -> PaperFigure:
    """Lengths above, returns below where there are any, in the order of the file; `width` in inches."""
    with style():
        figure = PaperFigure(width, 0.75 * width if found.returns else 0.45 * width)
        shown = {"steps": found.lengths, "return": found.returns}
        panels = figure.subplots(2 if found.returns else 1, 1, sharex=True, squeeze=False)[:, 0]
        for axes, (label, values) in zip(panels, shown.items(), strict=False):
            axes.plot(
                range(len(values)),
                values,
                linestyle="none",
                marker="o",
                markersize=2.0,
                alpha=0.7,
                markeredgewidth=0.0,
                color="C0",
                rasterized=len(values) > MOST_DETAILED,
            )
            axes.set_ylabel(label)
        panels[0].set_ylim(bottom=0.0)
        panels[-1].set_xlabel("episode, in the order of the file")
    return figure.settle(f"Episodes of {name}: {summary(found)}.")
