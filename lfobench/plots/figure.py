"""A figure that carries its caption and always saves to the same bytes."""

from __future__ import annotations

import io
import math
import os
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, TypeAlias

import matplotlib
import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.textpath import TextPath

from lfobench.errors import UserError
from lfobench.tables.table import Column
from lfobench.text import harmless

WIDTHS = {"column": 3.3, "page": 6.8}
"""Inches of a figure in one column of a paper, and across both."""

LABEL_SIZE = 7.5
SMALL_SIZE = 6.5
"""Points; the smallest text of any figure."""

REFERENCE_GREY = "#8a8a8a"
PAPER, INK = "#ffffff", "#000000"

_RC: dict[str, Any] = {
    # It comes with matplotlib, so it is the same everywhere.
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": LABEL_SIZE,
    "axes.titlesize": LABEL_SIZE,
    "axes.labelsize": LABEL_SIZE,
    "figure.labelsize": LABEL_SIZE,
    "legend.fontsize": LABEL_SIZE,
    "xtick.labelsize": SMALL_SIZE,
    "ytick.labelsize": SMALL_SIZE,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 3.0,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "legend.frameon": False,
    "legend.handlelength": 3.0,
    "savefig.dpi": 300,
    "figure.dpi": 150,
    # Names of methods and tasks are text, whatever characters they hold.
    "text.parse_math": False,
    # TrueType: Type 3 fonts, the default, are refused by many publishers' checks.
    "pdf.fonttype": 42,
    # Text stays text, so that it can be searched and edited; where DejaVu Sans is absent a narrower font stands in.
    "svg.fonttype": "none",
    "svg.hashsalt": "lfobench",
}

LineStyle: TypeAlias = Literal["solid"] | tuple[float, tuple[float, ...]]

# From dark to light and back, so that neighbours differ in grey as well.
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#000000", "#56B4E9", "#F0E442")
# No crosses: those are diverged seeds.
_MARKERS = ("o", "s", "^", "D", "v", "p", "<", ">")
_LINES: tuple[LineStyle, ...] = (
    "solid",
    (0, (5.0, 1.5)),
    (0, (1.0, 1.0)),
    (0, (5.0, 1.5, 1.0, 1.5)),
    (0, (3.0, 1.0, 1.0, 1.0, 1.0, 1.0)),
    (0, (2.5, 1.0)),
    (0, (8.0, 2.0)),
    (0, (8.0, 1.5, 1.0, 1.5, 1.0, 1.5)),
)


@dataclass(frozen=True)
class Look:
    """Appearance of a method: `colour`, and for print in grey `marker` and `line`."""

    colour: str
    marker: str
    line: LineStyle


def look(slot: int) -> Look:
    """The look number `slot`, counted from 0; the first 64 are distinct."""
    again, place = divmod(slot, len(_COLOURS))
    shifted = (place + again) % len(_COLOURS)
    return Look(_COLOURS[place], _MARKERS[shifted], _LINES[shifted])


def looks(columns: Sequence[Column], methods: Sequence[str] = ()) -> dict[Column, Look]:
    """One look per column, all distinct.

    Looks are handed out to `methods` first, whether or not they are shown: a figure of some methods then has the
    colours of a figure of all. Other methods follow as they appear, then further columns of a method that has one.
    """
    names = list(dict.fromkeys([*methods, *(column.method for column in columns)]))
    slots: dict[str | Column, int] = {name: slot for slot, name in enumerate(names)}
    chosen: dict[Column, Look] = {}
    further = len(names)
    for column in columns:
        slot = slots.pop(column.method, None)
        if slot is None:
            slot, further = further, further + 1
        chosen[column] = look(slot)
    return chosen


def style() -> AbstractContextManager[None]:
    """The settings of a figure, in place of a user's own, for as long as the context lasts."""
    return matplotlib.style.context(["default", _RC])


FORMATS = ("png", "svg", "pdf")


class PaperFigure(Figure):
    """A figure of an exact size in inches, drawn and saved in this project's style wherever that happens.

    Saved, its caption goes along as the file's description, and no date does. A notebook shows it without pyplot.

    Attributes:
        caption: what is shown, how it was computed and from what; to be pasted under the figure.
    """

    def __init__(self, *size: float, layout: str | None = "constrained") -> None:
        super().__init__(figsize=size, layout=layout)  # type: ignore[arg-type]
        self.caption = ""

    def settle(self, caption: str) -> PaperFigure:
        """This figure with its caption, laid out once and for all: a layout made again differs in the last digit."""
        self.caption = caption
        with style():
            self.draw_without_rendering()
        self.set_layout_engine("none")
        return self

    def draw(self, renderer: RendererBase) -> None:
        """Draw in the style: ticks and their labels are made only now."""
        with style():
            super().draw(renderer)

    def savefig(self, fname: str | os.PathLike[str] | IO[Any], *, transparent: bool | None = None, **how: Any) -> None:
        """Save as matplotlib does, with settings and metadata that make equal figures equal bytes."""
        suffix = Path(fname).suffix.removeprefix(".") if isinstance(fname, str | os.PathLike) else ""
        name = str(how.get("format") or suffix or matplotlib.rcParams["savefig.format"]).lower()
        how["metadata"] = self._metadata(name) | (how.get("metadata") or {})
        with style():
            super().savefig(fname, transparent=transparent, **how)

    def image(self, format_name: str) -> bytes:
        """The file's content in one of `FORMATS`."""
        buffer = io.BytesIO()
        self.savefig(buffer, format=format_name)
        return buffer.getvalue()

    def _repr_png_(self) -> bytes:
        return self.image("png")

    def _metadata(self, format_name: str) -> dict[str, str | None]:
        metadata: dict[str, dict[str, str | None]] = {
            "png": {"Description": self.caption},
            "svg": {"Description": self.caption, "Date": None},
            "pdf": {"Subject": self.caption, "CreationDate": None},
        }
        return metadata.get(format_name, {})


def format_of(path: Path) -> str:
    """The format that a file's name asks for.

    Raises:
        UserError: it is none of `FORMATS`.
    """
    name = path.suffix.removeprefix(".").lower()
    if name not in FORMATS:
        raise UserError(f"'{path}' does not say which format to draw.", "End the name in .png, .svg or .pdf.")
    return name


LINE_SPACING = 1.2
"""Distance of two lines of text, in sizes of the text."""


def one_line(text: str) -> str:
    """`text` on one line; characters that cannot be printed, which SVG does not allow, are escaped."""
    return harmless(" ".join(text.split()))


def text_width(text: str, size: float) -> float:
    """Inches that `text` takes in points `size`; the longest line counts. Only inside `style.style`."""
    font = FontProperties(size=size)
    return max(
        (float(TextPath((0, 0), line, prop=font).get_extents().width) / 72.0 for line in text.split("\n") if line),
        default=0.0,
    )


def text_height(text: str, size: float) -> float:
    """Inches from the top of the first line of `text` to the bottom of the last, in points `size`."""
    return (text.count("\n") + 1) * size * LINE_SPACING / 72.0


def wrapped(text: str, size: float, inches: float, lines: int = 3) -> str:
    """`text` in at most so many `lines` of `inches`, broken at spaces and hyphens where it can be; the rest is cut."""
    text = one_line(text)
    width = text_width(text, size)
    if width <= inches:
        return text
    characters = max(4, int(len(text) * inches / width))
    return "\n".join(textwrap.wrap(text, characters, max_lines=lines, placeholder="…", break_on_hyphens=True))


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
    # Where axes are not shared, each has labels of its own.
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
        # The last panel of a column has tick labels, even where other columns are longer.
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
