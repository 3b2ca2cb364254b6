"""Which reader a file is for."""

from __future__ import annotations

import hashlib
from pathlib import Path

from lfobench.data.readers import d4rl, minari, robomimic
from lfobench.data.readers.hdf5 import OTHER, FileProblem, listed, opened
from lfobench.data.readers.reading import Reading
from lfobench.data.readers.start import check_start

IN_MINARI_FOLDER = Path("data") / "main_data.hdf5"


def data_file(path: Path) -> Path:
    """The HDF5 file behind a path: itself, or that of a Minari dataset's folder.

    Raises:
        FileProblem: a folder that is no Minari dataset.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise FileProblem("it is neither a file nor a folder", OTHER)
    if not path.is_dir():
        return path
    for inside in (IN_MINARI_FOLDER, Path(IN_MINARI_FOLDER.name)):
        if (path / inside).is_file():
            return path / inside
    raise FileProblem(f"it is a folder without {IN_MINARI_FOLDER}, so no Minari dataset", "Name a file.")


def sha256(path: Path) -> str:
    """SHA-256 (hex) of the HDF5 file behind a path.

    Raises:
        FileProblem: a folder that is no Minari dataset.
        OSError: it cannot be read.
    """
    with data_file(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read(path: Path, horizon: int | None = None) -> Reading:
    """The episodes of a file, by whichever reader knows its layout.

    Args:
        path: an HDF5 file, or a Minari dataset's folder.
        horizon: steps after which an episode is cut, for files that do not say it themselves.

    Raises:
        FileProblem: what is wrong with it.
        OSError: it cannot be read.
    """
    file = data_file(path)
    check_start(file)
    with opened(file) as root:
        if minari.is_minari(root):
            return minari.read(root)
        if robomimic.is_robomimic(root):
            return robomimic.read(root)
        lacking = d4rl.lacking(root)
        if not lacking:
            return d4rl.read(root, horizon)
        if len(lacking) == 1:
            raise FileProblem(
                f"it is in D4RL's layout but for the field '{lacking[0]}', which is missing (there: {listed(root)})",
                OTHER,
            )
        raise FileProblem(
            f"it has none of the known layouts: D4RL's needs the fields observations, actions and terminals, Minari's "
            f"groups episode_0, …, robomimic's groups data/demo_0, … (there: {listed(root)})",
            OTHER,
        )
