"""A figure that carries its caption and always saves to the same bytes."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import IO, Any

import matplotlib
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure

from lfobench.errors import UserError
from lfobench.render.plots.style import style

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
