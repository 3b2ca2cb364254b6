"""Arrays of plain numbers in untrusted files.

Nothing is followed out of an HDF5 file (external and virtual storage), no filter is loaded that HDF5 does not include,
and no array is made that is out of proportion to the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from lfobench.data.readers.hdf5 import AGAIN, DAMAGE, OTHER, FileProblem, Remedy, another, member, path_of, short
from lfobench.text import counted, shown

MOST_INFLATION = 1_100
"""Unpacked bytes per byte on disk, at the most; deflate gives up to 1032."""
BLOCK_BYTES = 8 * 2**20
"""Bytes read at once, or one row of chunks where that is more."""
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


class PlainArray(Protocol):
    """An array of plain numbers, checked, in a file or in memory.

    Attributes:
        field: its path in the file.
        shape: of the array.
        kind: of its numbers, e.g. ``float64``.
        block: rows that are read at once.
    """

    @property
    def field(self) -> str: ...  # noqa: D102
    @property
    def shape(self) -> tuple[int, ...]: ...  # noqa: D102
    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def block(self) -> int: ...  # noqa: D102
    @property
    def rows(self) -> int:
        """Length of the first axis."""
        ...

    def read(self, start: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `start` to `stop`.

        Raises:
            FileProblem: when the bytes cannot be read.
        """
        ...


@dataclass(frozen=True, slots=True)
class Held:
    """An array in memory; as `PlainArray`."""

    field: str
    values: NDArray[Any]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.values.shape

    @property
    def kind(self) -> str:
        """Type of its numbers."""
        return self.values.dtype.name

    @property
    def block(self) -> int:
        """All of its rows, which are in memory."""
        return max(1, self.rows)

    @property
    def rows(self) -> int:
        """Length of the first axis."""
        return len(self.values)

    def read(self, start: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `start` to `stop`."""
        return self.values[start:stop]


@dataclass(frozen=True, slots=True)
class Array:
    """An array in an HDF5 file, not yet read; as `PlainArray`.

    It is open only while it is checked and while it is read: a file may have one per field and episode, and an open one
    takes more memory in HDF5 than most of them have data.

    Attributes:
        group: that it lies in.
        name: in the group.
        shape: of the array.
        kind: of its numbers.
        block: rows that are read at once: whole chunks, and about `BLOCK_BYTES`.
    """

    group: h5py.Group
    name: str
    shape: tuple[int, ...]
    kind: str
    block: int

    @property
    def field(self) -> str:
        """Its path in the file."""
        return path_of(self.group, self.name)

    @property
    def rows(self) -> int:
        """Length of the first axis."""
        return self.shape[0]

    def read(self, start: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `start` to `stop`.

        Raises:
            FileProblem: when the bytes cannot be read.
        """
        rows = (self.rows if stop is None else stop) - start
        try:
            found = h5py.h5d.open(self.group.id, self.name.encode())
            read = np.empty((rows, *self.shape[1:]), found.dtype)
            place = found.get_space()
            place.select_hyperslab((start, *(0 for _ in self.shape[1:])), read.shape)
            found.read(h5py.h5s.create_simple(read.shape), place, read)
        except DAMAGE as error:
            raise FileProblem(f"field '{self.field}' cannot be read ({short(error)})", AGAIN) from error
        return read


def blocks(arrays: Sequence[PlainArray], further: int = 0) -> Iterator[tuple[int, list[NDArray[Any]]]]:
    """Every row of arrays of equal length, block by block.

    Args:
        arrays: at least one.
        further: rows beyond its end that each block has too, where there are any.

    Yields:
        The number of a block's first row, and the block of every array.
    """
    # A chunk must not be unpacked once for every block of an array that has smaller ones.
    rows, step = arrays[0].rows, max(each.block for each in arrays)
    for start in range(0, rows, step):
        stop = min(start + step + further, rows)
        yield start, [each.read(start, stop) for each in arrays]


def in_proportion(parts: Sequence[Array]) -> None:
    """Refusal of arrays that together have many more bytes than their file, where one array has many names.

    Raises:
        FileProblem: naming the first.
    """
    whole = sum(4 * math.prod(part.shape) for part in parts)
    if whole > MOST_INFLATION * (size := parts[0].group.file.id.get_filesize()):
        raise FileProblem(
            f"'{parts[0].field}' and its like in other episodes are {whole:,} bytes together, and the file has "
            f"{size:,}, so that most of them are one and the same",
            OTHER,
        )


def array(group: h5py.Group, name: str, dimensions: int, remedy: Remedy = another) -> Array:
    """Array of plain numbers directly below a group; `remedy` is that of a missing one.

    Raises:
        FileProblem: it is missing, or not what it should be; the field is named.
    """
    field = path_of(group, name)
    found = member(group, name, remedy)
    if not isinstance(found, h5py.Dataset):
        raise FileProblem(f"'{field}' is not an array", OTHER)
    try:
        return Array(group, name, *_checked(found, field, dimensions))
    except DAMAGE as error:
        raise FileProblem(f"field '{field}' is damaged ({short(error)})", AGAIN) from error


def _checked(found: h5py.Dataset, field: str, dimensions: int) -> tuple[tuple[int, ...], str, int]:
    """Shape of an array, kind of its numbers and rows of a block."""
    kind, shape, plist = found.dtype, found.shape, found.id.get_create_plist()
    if shape is None:
        raise FileProblem(f"field '{field}' has nothing; it should have {counted(dimensions, 'dimension')}", OTHER)
    check_plain(field, kind, shape, dimensions)
    layout = plist.get_layout()
    if layout == h5py.h5d.VIRTUAL or plist.get_external_count():
        raise FileProblem(f"field '{field}' lies in other files, which are never followed", OTHER)
    if unknown := [name for name in _filters(plist) if name not in FILTERS]:
        raise FileProblem(
            f"field '{field}' needs the filter {unknown[0]}, and none is loaded from outside",
            "Repack it: h5repack -f GZIP=4 FILE NEW.",
        )
    stored, whole = found.id.get_storage_size(), math.prod(shape) * kind.itemsize
    if whole > MOST_INFLATION * stored:
        raise FileProblem(
            f"field '{field}' declares {whole:,} bytes {shape} and stores {stored:,}, so most of it is not there", AGAIN
        )
    width = kind.itemsize * math.prod(shape[1:])
    if layout != h5py.h5d.CHUNKED:
        return shape, kind.name, max(1, BLOCK_BYTES // width)
    chunks = plist.get_chunk()
    if math.prod(chunks) * kind.itemsize > MOST_CHUNK_BYTES:
        raise FileProblem(f"field '{field}' has chunks {chunks}, too large to be read in parts", OTHER)
    needed = math.prod(-(-size // chunk) for size, chunk in zip(shape, chunks, strict=True))
    if (there := found.id.get_num_chunks()) < needed:
        raise FileProblem(
            f"field '{field}' was never written to its end: {there:,} of {counted(needed, 'chunk')} "
            f"{'is' if there == 1 else 'are'} there",
            AGAIN,
        )
    return shape, kind.name, max(chunks[0], BLOCK_BYTES // width // chunks[0] * chunks[0])


def check_plain(field: str, kind: np.dtype[Any], shape: tuple[int, ...], dimensions: int) -> None:
    """Refusal of anything but plain numbers with so many dimensions and at least one column.

    Raises:
        FileProblem: naming the field.
    """
    if kind.kind not in "biuf" or kind.itemsize > 8 or kind.names is not None:
        raise FileProblem(f"field '{field}' holds {_described(kind)}, not plain numbers", OTHER)
    if len(shape) != dimensions:
        raise FileProblem(f"field '{field}' has {counted(len(shape), 'dimension')}; it should have {dimensions}", OTHER)
    if 0 in shape[1:]:
        raise FileProblem(f"field '{field}' has no column", OTHER)


def _filters(plist: h5py.h5p.PropDCID) -> list[str]:
    codes = [plist.get_filter(index)[0] for index in range(plist.get_nfilters())]
    return [_FILTER_NAMES.get(code, f"number {code}") for code in codes]


def _described(kind: np.dtype[Any]) -> str:
    if kind.kind in "SUOT" or h5py.check_string_dtype(kind) is not None:
        return "text or objects"
    return f"values of type {shown(str(kind))}"
