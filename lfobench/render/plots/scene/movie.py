"""Films as files: GIF, which needs nothing more, and MP4, which needs an encoder."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image

from lfobench.errors import UserError
from lfobench.render.plots.scene.film import Film

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
