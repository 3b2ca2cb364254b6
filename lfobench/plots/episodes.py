"""Episodes of a data file, one mark each: how long they are, how they ended and what they return."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from lfobench.analyses.diagnosis import not_terminated, summary
from lfobench.data.doctor import Diagnosis
from lfobench.plots.figure import LABEL_SIZE, REFERENCE_GREY, SMALL_SIZE, PaperFigure, look, style, text_height, wrapped

MOST_DETAILED = 2_000
"""Marks beyond this number are drawn as an image, so that a .pdf of 45,000 episodes stays small."""
_PANEL, _LEGEND, _MARGIN = 1.05, 0.35, 0.05
"""Inches: height of a panel, of the legend below the last one, margin of the text."""


def episodes(found: Diagnosis, name: str, width: float) -> PaperFigure:
    """Lengths above, returns below where there are any, in the order of the file; `width` in inches."""
    shown = {"steps": found.lengths} | ({"return": found.returns} if found.returns else {})
    with style():
        text = width - 3 * _MARGIN
        title, subtitle = wrapped(name, LABEL_SIZE, text, 2), wrapped(summary(found), SMALL_SIZE, text, 5)
        title_height = text_height(title, LABEL_SIZE) + _MARGIN / 2
        head = title_height + text_height(subtitle, SMALL_SIZE) + _MARGIN
        height = head + _PANEL * len(shown) + _LEGEND
        figure = PaperFigure(width, height)
        figure.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 1.0 - head / height))
        for line, size, above in ((title, LABEL_SIZE, 0.0), (subtitle, SMALL_SIZE, title_height)):
            place = (_MARGIN / width, 1.0 - (above + _MARGIN) / height)
            figure.text(*place, line, fontsize=size, va="top", ha="left").set_in_layout(False)
        panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (label, values) in zip(panels, shown.items(), strict=True):
            _draw(axes, found, values)
            axes.set_ylabel(label)
        if found.horizon is not None:
            panels[0].axhline(found.horizon, color=REFERENCE_GREY, linewidth=0.8, zorder=0, label="horizon")
        panels[0].set_ylim(bottom=0.0)
        panels[-1].set_xlabel("episode, in the order of the file")
        panels[-1].xaxis.set_major_locator(MaxNLocator("auto", integer=True))
        figure.align_ylabels()
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left", ncols=3, handlelength=1.2)
    return figure.settle(f"Episodes of {name}: {summary(found)}.")


def _draw(axes: Axes, found: Diagnosis, values: tuple[int, ...] | tuple[float, ...]) -> None:
    for slot, (label, ended) in enumerate(((not_terminated(found), False), ("terminated", True))):
        chosen = [index for index, each in enumerate(found.terminations) if each == ended]
        if chosen:
            axes.plot(
                chosen,
                [values[index] for index in chosen],
                linestyle="none",
                marker=look(slot).marker,
                markersize=2.5,
                alpha=0.7,
                clip_on=False,
                markeredgewidth=0.0,
                color=look(slot).colour,
                rasterized=len(chosen) > MOST_DETAILED,
                label=label,
            )
