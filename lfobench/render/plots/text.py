"""Text of a figure: names as they are written, measured, and broken where they do not fit."""

from __future__ import annotations

import textwrap

from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from lfobench.words import harmless

LINE_SPACING = 1.2
"""Distance of two lines of text, in sizes of the text."""


def plain(text: str) -> str:
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
    text = plain(text)
    width = text_width(text, size)
    if width <= inches:
        return text
    characters = max(4, int(len(text) * inches / width))
    return "\n".join(textwrap.wrap(text, characters, max_lines=lines, placeholder="…", break_on_hyphens=True))
