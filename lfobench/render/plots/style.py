"""How every figure looks: column widths, fonts, and one colour, marker and line style per method.

Colours: M. Okabe and K. Ito, "Color universal design", 2008: eight colours that are told apart under every common
form of colour blindness. Marker and line style differ as well, so that a figure is readable in grey.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import matplotlib.style

from lfobench.render.table import Column

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
    """What tells a method from the others: in colour by `colour`, in grey by `marker` and `line`."""

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
