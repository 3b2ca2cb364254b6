"""Formats of data files: choice of the reader, and hash of the bytes behind a path."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from lfobench.data.readers import d4rl, lerobot, minari, npz, robomimic
from lfobench.data.readers.hdf5 import AGAIN, OTHER, FileProblem, enumerated, members, opened
from lfobench.data.readers.reading import Keys, Reading, no_choice
from lfobench.text import shown

SIGNATURE = b"\x89HDF\r\n\x1a\n"
ARCHIVE = b"PK\x03\x04"
_PAGE = re.compile(rb"<(!doctype|!--|html|head|body|script|meta|title|\?xml)", re.IGNORECASE)
_JSON = re.compile(rb'(\{\s*["}]|\[\s*[\[{"\]])')


def is_archive(path: Path) -> bool:
    """True if a file begins as an NPZ archive does.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return file.read(len(ARCHIVE)) == ARCHIVE


def check_start(path: Path) -> None:
    """Refusal of a file that does not begin as an HDF5 file does.

    Raises:
        FileProblem: with the kind of file that it is, where that is known.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        check_first_bytes(file.read(512))


def check_first_bytes(start: bytes) -> None:
    """Refusal of first bytes that belong neither to an HDF5 file nor to an NPZ archive.

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
        answer = shown(text.decode(errors="replace"))
        raise FileProblem(
            f"it is JSON, not data; an answer of the host was saved instead: {answer}",
            "Download it again, or take it from another mirror.",
        )
    if text.startswith(b"version https://git-lfs"):
        raise FileProblem("it is a Git LFS pointer, not the data", "Fetch the data itself: git lfs pull.")
    if start.startswith(b"PAR1"):
        raise FileProblem("it is one Parquet table", "Name the folder of the LeRobot dataset that it belongs to.")
    if start.startswith(b"\x93NUMPY"):
        raise FileProblem("it is one array of NumPy", "Save observations, actions and terminals with numpy.savez.")
    raise FileProblem("it is neither an HDF5 file nor an NPZ archive", OTHER)


IN_MINARI_FOLDER = Path("data") / "main_data.hdf5"


def data_files(path: Path) -> list[Path]:
    """The files behind a path: itself, that of a Minari dataset's folder, or those of LeRobot's or of NPZ archives.

    Raises:
        FileProblem: it is neither a file nor a folder with a dataset.
        OSError: a folder cannot be listed.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise FileProblem("it is neither a file nor a folder", OTHER)
    if not path.is_dir():
        return [path]
    for inside in (IN_MINARI_FOLDER, Path(IN_MINARI_FOLDER.name)):
        if (path / inside).is_file():
            return [path / inside]
    if lerobot.is_lerobot(path):
        return lerobot.files_of(path)
    if archives := npz.archives(path):
        return archives
    raise FileProblem(
        f"it is a folder without {IN_MINARI_FOLDER} (Minari), {lerobot.INFO} (LeRobot) or *{npz.SUFFIX}", "Name a file."
    )


def stamp(path: Path) -> tuple[int, int, int]:
    """Size and latest times of the files behind a path, which change whenever one of them does.

    Raises:
        FileProblem: as `data_files` does.
        OSError: a file cannot be inspected.
    """
    found = [file.stat() for file in data_files(path)]
    return (
        sum(each.st_size for each in found),
        max(each.st_mtime_ns for each in found),
        max(each.st_ctime_ns for each in found),
    )


def sha256(path: Path) -> str:
    """SHA-256 (hex) of the file behind a path; for a folder, of lines ``HASH  NAME`` in reading order.

    A Minari dataset's single file has the same hash as its folder.

    Raises:
        FileProblem: as `data_files` does.
        OSError: a file cannot be read.
    """
    files = data_files(path)
    hashes = []
    for each in files:
        with each.open("rb") as file:
            hashes.append(hashlib.file_digest(file, "sha256").hexdigest())
    if files == [path] or files[0].name == IN_MINARI_FOLDER.name:
        return hashes[0]
    lines = (f"{mark}  {file.relative_to(path).as_posix()}\n" for mark, file in zip(hashes, files, strict=True))
    return hashlib.sha256("".join(lines).encode(errors="surrogateescape")).hexdigest()


def read(path: Path, horizon: int | None = None, keys: Keys = None) -> Reading:
    """Episodes of a file or a folder, by the reader of its layout.

    Args:
        path: an HDF5 file, an NPZ archive, or a folder as `data_files` knows it.
        horizon: steps after which an episode is cut, for files without time-outs.
        keys: parts of an observation, where there is a choice; None takes those of the layout.

    Raises:
        FileProblem: with the cause.
        OSError: it cannot be read.
    """
    files = data_files(path)
    if files[0] == path / lerobot.INFO:
        return lerobot.read(path, keys)
    in_folder = files[0] != path and files[0].suffix == npz.SUFFIX
    if in_folder or is_archive(files[0]):
        if keys is not None:
            raise no_choice("NPZ")
        return npz.read(files, horizon, in_folder)
    (file,) = files
    check_start(file)
    with opened(file) as root:
        if minari.is_minari(root):
            return minari.read(root, keys)
        if robomimic.is_robomimic(root):
            return robomimic.read(root, keys)
        lacking = d4rl.lacking(root)
        if not lacking:
            if keys is not None:
                raise no_choice("D4RL")
            return d4rl.read(root, horizon)
        if len(lacking) == 1:
            raise FileProblem(
                f"it is in D4RL's layout but for the field '{lacking[0]}', which is missing "
                f"(there: {enumerated(members(root))})",
                OTHER,
            )
        raise FileProblem(
            f"it has none of the known layouts: D4RL's needs the fields observations, actions and terminals, Minari's "
            f"groups episode_0, …, robomimic's groups data/demo_0, … (there: {enumerated(members(root))})",
            OTHER,
        )
