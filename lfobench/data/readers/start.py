"""How a file begins: what is no data file is mostly something well known that was saved in its place."""

from __future__ import annotations

import re
from pathlib import Path

from lfobench.data.readers.hdf5 import AGAIN, OTHER, FileProblem
from lfobench.words import shown

SIGNATURE = b"\x89HDF\r\n\x1a\n"
ARCHIVE = b"PK\x03\x04"
_PAGE = re.compile(rb"<(!doctype|!--|html|head|body|script|meta|title|\?xml)", re.IGNORECASE)
_JSON = re.compile(rb'(\{\s*["}]|\[\s*[\[{"\]])')


def is_archive(path: Path) -> bool:
    """Whether a file begins as an NPZ archive does.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return file.read(len(ARCHIVE)) == ARCHIVE


def check_start(path: Path) -> None:
    """Refuses what does not begin as an HDF5 file does.

    Raises:
        FileProblem: saying what it is instead, where that can be told.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        check_first_bytes(file.read(512))


def check_first_bytes(start: bytes) -> None:
    """Refuses the first bytes of what is neither an HDF5 file nor an NPZ archive.

    Raises:
        FileProblem: as `check_start` does.
    """
    if start.startswith((SIGNATURE, ARCHIVE)):
        return
    if not start:
        raise FileProblem("it is empty", AGAIN)
    text = start.removeprefix(b"\xef\xbb\xbf").lstrip()
    if _PAGE.match(text):
        raise FileProblem(
            "it is a web page, not data; a login page of the network or a notice of the host was saved instead",
            "Download it again, from another network or another mirror.",
        )
    if _JSON.match(text):
        said = shown(text.decode(errors="replace"))
        raise FileProblem(
            f"it is JSON, not data; an answer of the host was saved instead: {said}",
            "Download it again, or take it from another mirror.",
        )
    if text.startswith(b"version https://git-lfs"):
        raise FileProblem("it is a Git LFS pointer, not the data", "Fetch the data itself: git lfs pull.")
    if start.startswith(b"PAR1"):
        raise FileProblem("it is one Parquet table", "Name the folder of the LeRobot dataset that it belongs to.")
    if start.startswith(b"\x93NUMPY"):
        raise FileProblem("it is one array of NumPy", "Save observations, actions and terminals with numpy.savez.")
    raise FileProblem("it is neither an HDF5 file nor an NPZ archive", OTHER)
