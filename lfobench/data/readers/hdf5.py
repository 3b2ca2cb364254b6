"""HDF5 files from anywhere, read with suspicion.

Nothing is followed out of the file (soft and external links, external and virtual storage), no filter is loaded that
HDF5 does not bring along, no array is made that is out of proportion to the file, and every array is of plain numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

SIGNATURE = b"\x89HDF\r\n\x1a\n"
MOST_INFLATION = 1_100
"""Bytes out of one byte on disk; deflate gives at most 1032."""
BLOCK_BYTES = 8 * 2**20
"""Read at once, or one row of chunks where that is more."""
MOST_CHUNK_BYTES = 2**29
FILTERS = frozenset({"gzip", "lzf", "shuffle", "fletcher32", "scaleoffset"})
_FILTER_NAMES = {
    h5py.h5z.FILTER_DEFLATE: "gzip",
    h5py.h5z.FILTER_LZF: "lzf",
    h5py.h5z.FILTER_SHUFFLE: "shuffle",
    h5py.h5z.FILTER_FLETCHER32: "fletcher32",
    h5py.h5z.FILTER_SCALEOFFSET: "scaleoffset",
    h5py.h5z.FILTER_NBIT: "nbit",
    h5py.h5z.FILTER_SZIP: "szip",
}


class FileProblem(Exception):
    """Why a file cannot be used: what is wrong with it, or with which of its fields, and what to do.

    Attributes:
        cause: a clause that follows the file's name, e.g. ``field 'rewards' has 9 rows, …``.
        remedy: a sentence.
    """

    def __init__(self, cause: str, remedy: str) -> None:
        super().__init__(cause)
        self.cause, self.remedy = cause, remedy


DAMAGE = (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError, AttributeError, SystemError)
"""What h5py raises over damaged bytes; a UnicodeError is a ValueError."""

AGAIN = "Download it again, or take it from another mirror."
OTHER = "Name another file, or mend this one."


@dataclass(frozen=True)
class Array:
    """An array of plain numbers in a file, checked and not yet read.

    Attributes:
        field: its path in the file.
        dataset: the open dataset.
    """

    field: str
    dataset: h5py.Dataset

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the array."""
        return tuple(int(size) for size in self.dataset.shape)

    @property
    def rows(self) -> int:
        """Length of the first axis."""
        return self.shape[0]

    @property
    def block(self) -> int:
        """Rows that are read at once: whole chunks, and about `BLOCK_BYTES`."""
        width = max(1, self.dataset.dtype.itemsize * int(np.prod(self.shape[1:], dtype=np.int64)))
        chunk = int(self.dataset.chunks[0]) if self.dataset.chunks else 1
        return int(max(chunk, BLOCK_BYTES // width // chunk * chunk))

    def read(self, start: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `start` to `stop`.

        Raises:
            FileProblem: when the bytes cannot be read.
        """
        try:
            read: NDArray[Any] = self.dataset[start : self.rows if stop is None else stop]
        except DAMAGE as error:
            raise FileProblem(f"field '{self.field}' cannot be read ({_short(error)})", AGAIN) from error
        return read


def blocks(arrays: Sequence[Array], further: int = 0) -> Iterator[tuple[int, list[NDArray[Any]]]]:
    """Every row of arrays of equal length, block by block.

    Args:
        arrays: at least one.
        further: rows beyond its end that each block has too, where there are any.

    Yields:
        The number of a block's first row, and the block of every array.
    """
    rows, step = arrays[0].rows, min(each.block for each in arrays)
    for start in range(0, rows, step):
        stop = min(start + step + further, rows)
        yield start, [each.read(start, stop) for each in arrays]


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading.

    Raises:
        FileProblem: it is no HDF5 file, or cut short.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        _check_start(file.read(512))
    try:
        file = h5py.File(path, "r")
    except DAMAGE as error:
        short = "truncated" in str(error)
        cause = "it is cut short: it ends before its own header says" if short else f"HDF5 rejects it ({_short(error)})"
        raise FileProblem(cause, AGAIN) from error
    with file:
        yield file


def _check_start(start: bytes) -> None:
    if start.startswith(SIGNATURE):
        return
    if not start:
        raise FileProblem("it is empty", AGAIN)
    text = start.lstrip().lower()
    if text.startswith((b"<!doctype", b"<html", b"<?xml")):
        raise FileProblem(
            "it is a web page, not data; a login page of the network or a notice of the host was saved instead", AGAIN
        )
    if text.startswith(b"version https://git-lfs"):
        raise FileProblem("it is a Git LFS pointer, not the data", "Fetch the data itself: git lfs pull.")
    raise FileProblem("it is not an HDF5 file", OTHER)


def members(group: h5py.Group) -> list[str]:
    """Names in a group, in the file's order.

    Raises:
        FileProblem: when the group is damaged.
    """
    try:
        return [str(name) for name in group]
    except DAMAGE as error:
        raise FileProblem(f"group '{group.name}' cannot be listed ({_short(error)})", AGAIN) from error


def subgroup(group: h5py.Group, name: str) -> h5py.Group:
    """A group directly below another.

    Raises:
        FileProblem: it is missing, a link out of its place, or no group.
    """
    found = _member(group, name)
    if not isinstance(found, h5py.Group):
        raise FileProblem(f"'{_path(group, name)}' is not a group", OTHER)
    return found


def is_group(group: h5py.Group, name: str) -> bool:
    """Whether there is a group of that name.

    Raises:
        FileProblem: nothing has that name, or a link out of its place.
    """
    return isinstance(_member(group, name), h5py.Group)


def array(group: h5py.Group, name: str, dimensions: int) -> Array:
    """An array of plain numbers directly below a group.

    Raises:
        FileProblem: it is missing, or not what it should be; the field is named.
    """
    field = _path(group, name)
    found = _member(group, name)
    if not isinstance(found, h5py.Dataset):
        raise FileProblem(f"'{field}' is not an array", OTHER)
    try:
        _check(found, field, dimensions)
    except DAMAGE as error:
        raise FileProblem(f"field '{field}' is damaged ({_short(error)})", AGAIN) from error
    return Array(field, found)


def _check(found: h5py.Dataset, field: str, dimensions: int) -> None:
    kind = found.dtype
    if kind.kind not in "biuf" or kind.itemsize > 8 or kind.names is not None:
        raise FileProblem(f"field '{field}' holds {_spelled(kind)}, not plain numbers", OTHER)
    if found.shape is None or len(found.shape) != dimensions:
        shape = "nothing" if found.shape is None else f"{len(found.shape)} dimensions"
        raise FileProblem(f"field '{field}' has {shape}; it should have {dimensions}", OTHER)
    if found.external is not None or found.is_virtual:
        raise FileProblem(f"field '{field}' lies in other files, which are never followed", OTHER)
    if unknown := [name for name in _filters(found) if name not in FILTERS]:
        raise FileProblem(
            f"field '{field}' needs the filter {unknown[0]}, and none is loaded from outside",
            "Repack it: h5repack -f GZIP=4 FILE NEW.",
        )
    if 0 in found.shape[1:]:
        raise FileProblem(f"field '{field}' has no column", OTHER)
    stored, whole = found.id.get_storage_size(), found.size * kind.itemsize
    if whole > MOST_INFLATION * stored:
        raise FileProblem(
            f"field '{field}' declares {whole:,} bytes {found.shape} and stores {stored:,}, so most of it is not there",
            AGAIN,
        )
    if found.chunks is None:
        return
    if int(np.prod(found.chunks, dtype=np.float64)) * kind.itemsize > MOST_CHUNK_BYTES:
        raise FileProblem(f"field '{field}' has chunks {found.chunks}, too large to be read in parts", OTHER)
    chunks = math.prod(-(-size // chunk) for size, chunk in zip(found.shape, found.chunks, strict=True))
    if (there := found.id.get_num_chunks()) < chunks:
        raise FileProblem(
            f"field '{field}' was never written to its end: {there:,} of {chunks:,} chunks are there", AGAIN
        )


def _filters(found: h5py.Dataset) -> list[str]:
    plist = found.id.get_create_plist()
    codes = [plist.get_filter(index)[0] for index in range(plist.get_nfilters())]
    return [_FILTER_NAMES.get(code, f"number {code}") for code in codes]


def _member(group: h5py.Group, name: str) -> object:
    """An object that lies in the group itself; its name is looked up once, as one link."""
    try:
        link = group.get(name, getlink=True)
        if link is None:
            there = ", ".join(members(group)[:12]) or "nothing"
            raise FileProblem(f"field '{_path(group, name)}' is missing (there: {there})", OTHER)
        if not isinstance(link, h5py.HardLink):
            raise FileProblem(f"'{_path(group, name)}' is a link to elsewhere, which is never followed", OTHER)
        return group[name]
    except DAMAGE as error:
        raise FileProblem(f"'{_path(group, name)}' cannot be opened ({_short(error)})", AGAIN) from error


def _path(group: h5py.Group, name: str) -> str:
    return f"{(group.name or '').strip('/')}/{name}".strip("/")


def _spelled(kind: np.dtype[Any]) -> str:
    if kind.kind in "SUOT" or h5py.check_string_dtype(kind) is not None:
        return "text or objects"
    return f"values of type {kind}"


def _short(error: BaseException) -> str:
    """An error of HDF5 in one short line."""
    text = " ".join(str(error).split())
    return text if len(text) <= 120 else f"{text[:117]}..."
