"""Small panels, one per task, that share the axis of scores; and the legend above them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from lfobench.render.plots.figure import PaperFigure
from lfobench.render.plots.style import LABEL_SIZE, REFERENCE_GREY, LineStyle, Look
from lfobench.render.plots.text import text_height, text_width, wrapped
from lfobench.render.table import Column

RANDOM, EXPERT = 0.0, 100.0
DEMONSTRATION_LINE: LineStyle = (0.0, (1.0, 2.0))

_PANEL_INCHES = 1.6
_PAGE_INCHES = 8.5
"""A grid that would be higher gets flatter panels, down to half of their height."""

_LABELS_INCHES = 0.45
_HANDLE_INCHES = 0.55


def panels(
    titles: Sequence[str], width: float, panel_height: float, share_x: bool = True, share_y: bool = True
) -> tuple[PaperFigure, list[Axes]]:
    """A figure of `width` inches with one panel of about `panel_height` inches per title, in rows of equal length."""
    across = min(len(titles), max(1, int(width / _PANEL_INCHES)))
    down = math.ceil(len(titles) / across)
    across = math.ceil(len(titles) / down)
    inches = (width - _LABELS_INCHES) / across
    # Where axes are not shared, the labels of each take room beside it.
    room = inches - 0.1 - (0.0 if share_y else _LABELS_INCHES)
    headings = [wrapped(title, LABEL_SIZE, room) for title in titles]
    title_height = max(text_height(heading, LABEL_SIZE) for heading in headings)
    fitting = (_PAGE_INCHES - _LABELS_INCHES) / down - title_height
    panel_height = min(panel_height, max(panel_height / 2.0, fitting))
    figure = PaperFigure(width, down * (panel_height + title_height) + _LABELS_INCHES)
    grid = figure.subplots(down, across, sharex=share_x, sharey=share_y, squeeze=False)
    cells: list[Axes] = list(grid.flat)
    for axes in cells[len(titles) :]:
        axes.remove()
    for index, (axes, heading) in enumerate(zip(cells, headings, strict=False)):
        axes.set_title(heading)
        # Nothing lies below the last panel of a column, even where the grid goes on beside it.
        if index + across >= len(titles):
            axes.tick_params(labelbottom=True)
    return figure, cells[: len(titles)]


def score_limits(scores: Iterable[float], ends: Iterable[float]) -> tuple[float, float]:
    """Limits of an axis of scores: all `scores`, random and expert, and `ends` of intervals within a quarter beyond.

    The interval of a few seeds can be many times as wide as all scores; the axis then cuts it.
    """
    points = [RANDOM, EXPERT, *scores]
    low, high = min(points), max(points)
    beyond = (high - low) / 4.0
    reached = [min(max(end, low - beyond), high + beyond) for end in ends]
    margin = (high - low) * 0.05
    return min(low, *reached, low) - margin, max(high, *reached, high) + margin


def reference_lines(axes: Axes, scores: Literal["x", "y"], demonstration: float | None) -> None:
    """Thin lines at the scores of random actions, of the expert, and of the demonstration where it is known."""
    line = axes.axvline if scores == "x" else axes.axhline
    for score in (RANDOM, EXPERT):
        line(score, color=REFERENCE_GREY, linewidth=0.5, zorder=0)
    if demonstration is not None:
        line(demonstration, color=REFERENCE_GREY, linewidth=1.0, linestyle=DEMONSTRATION_LINE, zorder=0)


def demonstration_handle() -> tuple[Line2D, str]:
    """The legend's entry for the demonstration."""
    return Line2D([], [], color=REFERENCE_GREY, linewidth=1.0, linestyle=DEMONSTRATION_LINE), "demonstration"


def legend(figure: PaperFigure, looks: Mapping[Column, Look], others: Sequence[tuple[Line2D, str]] = ()) -> None:
    """One legend above all panels, in as many columns as fit, and the room for it."""
    entries = [
        (Line2D([], [], color=look.colour, marker=look.marker, linestyle=look.line), column.label)
        for column, look in looks.items()
    ]
    entries += others
    width = figure.get_figwidth()
    labels = [wrapped(label, LABEL_SIZE, width - _HANDLE_INCHES - 0.2) for _, label in entries]
    entry = _HANDLE_INCHES + max(text_width(label, LABEL_SIZE) for label in labels)
    across = max(1, min(len(labels), int((width - 0.1) / (entry + 0.05))))
    drawn = figure.legend(
        [handle for handle, _ in entries],
        [""] * len(labels),
        loc="outside upper center",
        ncols=across,
        columnspacing=1.0,
        handletextpad=0.5,
        borderaxespad=0.2,
    )
    # Set afterwards: a label that begins with an underscore would be left out.
    for text, label in zip(drawn.get_texts(), labels, strict=True):
        text.set_text(label)
    entry_height = max(text_height(label, LABEL_SIZE) for label in labels) + LABEL_SIZE * 0.4 / 72.0
    figure.set_figheight(figure.get_figheight() + math.ceil(len(labels) / across) * entry_height)
