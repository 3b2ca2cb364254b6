"""A film of episodes from above: one picture per step, so that it can be shown as fast as it happened."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.text import Text
from numpy.typing import NDArray
from PIL import Image

from lfobench.contract.suite import Scene
from lfobench.errors import UserError
from lfobench.plots.figure import INK, PAPER, REFERENCE_GREY, one_line, style, wrapped
from lfobench.plots.scene import Episode, draw_table, outcome_looks, whole_table

Picture = NDArray[np.uint8]
"""Red, green and blue ``[height, width, 3]``."""

_WIDTH, _HEADER, _BLOCK = 800, 52, 16
"""Pixels: of a picture's width, of the text above the table, and of the squares that video encoders work in."""

_DPI, _TEXT_SIZE = 100, 10.5
_HELD_SECONDS = 1.0
"""Duration of the last picture of an episode."""

_TRAIL_SECONDS = 1.0
"""Length of the puck's trail; the end-effector's has no limit."""

_EFFECTOR, _PUCK = "#0072B2", "#D55E00"


@dataclass(frozen=True)
class _Movable:
    """Artists that change from picture to picture, in drawing order."""

    effector_trail: Line2D
    puck_trail: Line2D
    effector: Circle
    puck: Circle
    time: Text
    outcome: Text


class Film:
    """Episodes one after the other; picture k is made when it is asked for.

    Args:
        scene: the table.
        title: the line above the picture.
        episodes: at least one.
        outcomes: known ones, whether or not they happen: they decide the colours.
    """

    def __init__(self, scene: Scene, title: str, episodes: Sequence[Episode], outcomes: Iterable[str] = ()) -> None:
        self._episodes = episodes
        self.pictures_per_second = 1.0 / episodes[0].step_seconds
        held = round(_HELD_SECONDS * self.pictures_per_second)
        self._moments = [
            (number, min(step, len(episode.effector) - 1))
            for number, episode in enumerate(episodes)
            for step in range(len(episode.effector) + held)
        ]
        self._looks = outcome_looks([*outcomes, *(episode.outcome for episode in episodes)])
        with style():
            self._figure, self._movable = _stage(scene, title)
            canvas: Any = FigureCanvasAgg(self._figure)
            canvas.draw()
        self._canvas = canvas
        self._background = self._canvas.copy_from_bbox(self._figure.bbox)

    def __len__(self) -> int:
        return len(self._moments)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of every picture in pixels, multiples of 16."""
        width, height = self._canvas.get_width_height()
        return width, height

    def picture(self, index: int) -> Picture:
        """Picture number `index`: only what moves is drawn anew."""
        number, step = self._moments[index]
        self._move(self._episodes[number], step)
        self._canvas.restore_region(self._background)
        for artist in vars(self._movable).values():
            self._figure.draw_artist(artist)
        return np.array(self._canvas.buffer_rgba())[..., :3]

    def _move(self, episode: Episode, step: int) -> None:
        movable = self._movable
        movable.effector_trail.set_data(*episode.effector[: step + 1].T)
        movable.effector.center = tuple(episode.effector[step])
        movable.puck.set_visible(episode.puck is not None)
        if episode.puck is not None:
            first = max(0, step - round(_TRAIL_SECONDS / episode.step_seconds))
            movable.puck_trail.set_data(*episode.puck[first : step + 1].T)
            movable.puck.center = tuple(episode.puck[step])
        movable.time.set_text(f"start {episode.start:2d}  {step * episode.step_seconds:5.2f} s")
        over = step == len(episode.effector) - 1
        movable.outcome.set_text(one_line(episode.outcome) if over else "")
        movable.outcome.set_color(self._looks[episode.outcome].colour)


def _stage(scene: Scene, title: str) -> tuple[Figure, _Movable]:
    """The figure with all that stays, and what will move on it; whole blocks of pixels."""
    low, high, bottom, top = whole_table(scene)
    table = _WIDTH * (top - bottom) / (high - low)
    height = _BLOCK * round((table + _HEADER) / _BLOCK)
    figure = Figure(figsize=(_WIDTH / _DPI, height / _DPI), dpi=_DPI, facecolor=PAPER)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0 - _HEADER / height))
    axes.set_axis_off()
    axes.set_xlim(low, high)
    axes.set_ylim(bottom, top)
    axes.set_aspect("equal", adjustable="box")
    draw_table(axes, scene, "downhill")
    upper, lower = 1.0 - 0.27 * _HEADER / height, 1.0 - 0.71 * _HEADER / height
    shown = wrapped(title, _TEXT_SIZE, 0.95 * _WIDTH / _DPI, lines=1)
    figure.text(0.012, upper, shown, size=_TEXT_SIZE, va="center")
    movable = _Movable(
        Line2D([], [], color=_EFFECTOR, linewidth=1.2, alpha=0.6),
        Line2D([], [], color=_PUCK, linewidth=2.5, alpha=0.4),
        Circle((0.0, 0.0), scene.effector_radius, facecolor=_EFFECTOR, edgecolor=INK, linewidth=0.8, alpha=0.85),
        Circle((0.0, 0.0), scene.puck_radius or 0.0, facecolor=_PUCK, edgecolor=INK, linewidth=0.8),
        Text(0.012, lower, "", size=_TEXT_SIZE, va="center", family="monospace", color=REFERENCE_GREY),
        Text(0.27, lower, "", size=_TEXT_SIZE, va="center", weight="bold"),
    )
    for artist in (movable.effector_trail, movable.puck_trail):
        axes.add_line(artist)
    for patch in (movable.effector, movable.puck):
        axes.add_patch(patch)
    for text in (movable.time, movable.outcome):
        text.set_transform(figure.transFigure)
        figure.add_artist(text)
    for artist in vars(movable).values():
        artist.set_animated(True)
    return figure, movable


FORMATS = ("gif", "mp4")

_COLOURS = 128
_SAMPLES = 8
"""Pictures from which a GIF's colours are chosen; the last of them is the film's last."""


def movie_format(path: Path) -> str:
    """The format that a file's name asks for.

    Raises:
        UserError: it is none of `FORMATS`, or what encodes it is not installed.
    """
    name = path.suffix.removeprefix(".").lower()
    if name not in FORMATS:
        raise UserError(f"'{path}' does not say which kind of film to write.", "End the name in .gif or .mp4.")
    if name == "mp4" and find_spec("imageio_ffmpeg") is None:
        raise UserError(
            f"'{path}' needs an encoder that is not installed.",
            "Install it with pip install 'lfobench[video]', or end the name in .gif.",
        )
    return name


def write_movie(film: Film, path: Path, format_name: str) -> None:
    """Write a film to `path` in one of `FORMATS`, at the pace at which it happened.

    Raises:
        OSError: the disk or the encoder refuses.
    """
    if format_name == "gif":
        _write_gif(film, path)
    else:
        _write_mp4(film, path)


def _write_gif(film: Film, path: Path) -> None:
    # One set of colours for all pictures: the parts of a picture that stay are then equal bytes, and cost nothing.
    chosen = np.linspace(0, len(film) - 1, _SAMPLES).astype(int)
    sample = Image.fromarray(np.concatenate([film.picture(index) for index in chosen]))
    palette = sample.quantize(_COLOURS, Image.Quantize.MEDIANCUT)

    def pictures() -> Iterator[Image.Image]:
        for index in range(len(film)):
            picture = Image.fromarray(film.picture(index))
            yield picture.quantize(palette=palette, dither=Image.Dither.NONE)

    shown = pictures()
    milliseconds = round(1000.0 / film.pictures_per_second)
    next(shown).save(path, "gif", save_all=True, append_images=shown, duration=milliseconds, loop=0)


def _write_mp4(film: Film, path: Path) -> None:
    import imageio_ffmpeg

    # The file's name may be a temporary one, which does not say what it is.
    encoder = imageio_ffmpeg.write_frames(
        str(path), film.size, fps=film.pictures_per_second, quality=8, output_params=["-f", "mp4"]
    )
    encoder.send(None)
    try:
        for index in range(len(film)):
            encoder.send(np.ascontiguousarray(film.picture(index)))
    except OSError as error:
        # It comes with the encoder's whole command and log.
        raise OSError(str(error).strip().splitlines()[-1]) from error
    finally:
        encoder.close()
