"""A shard's file: what its header says, and its arrays, read from disk straight to where they are to lie."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors import safe_open

Arrays = dict[str, NDArray[Any]]


class _Kind(NamedTuple):
    code: str
    dtype: type[np.generic]
    dimensions: int


ARRAYS = {
    "observations": _Kind("F32", np.float32, 2),
    "actions": _Kind("F32", np.float32, 2),
    "rewards": _Kind("F32", np.float32, 1),
    "lengths": _Kind("I64", np.int64, 1),
    "terminated": _Kind("BOOL", np.bool_, 1),
}


@dataclass(frozen=True)
class Shard:
    """A file's header.

    Attributes:
        path: of the file.
        metadata: as it was written with the arrays.
        shapes: of every array, in the order in which their bytes end the file.
    """

    path: Path
    metadata: dict[str, str]
    shapes: dict[str, tuple[int, ...]]


def open_shard(path: Path) -> Shard:
    """Read a header.

    Raises:
        SafetensorError: when the file is not what safetensors writes.
        ValueError: when its arrays are not those of a shard.
        OSError: when it cannot be read.
    """
    with safe_open(path, framework="numpy") as file:
        slices = {name: file.get_slice(name) for name in file.offset_keys()}
        shapes = {name: tuple(array.get_shape()) for name, array in slices.items()}
        found = {name: (array.get_dtype(), len(shapes[name])) for name, array in slices.items()}
        if found != {name: (kind.code, kind.dimensions) for name, kind in ARRAYS.items()}:
            raise ValueError(_differences(found))
        return Shard(path, file.metadata() or {}, shapes)


def _differences(found: dict[str, tuple[str, int]]) -> str:
    """What a shard's arrays lack, or have beyond or other than they should."""
    lacking = [f"it lacks {name}" for name in ARRAYS if name not in found]
    unknown = [f"it has the unknown array {name}" for name in found if name not in ARRAYS]
    other = [
        f"{name} is {code} of {dimensions} dimensions, not {kind.code} of {kind.dimensions}"
        for name, kind in ARRAYS.items()
        for code, dimensions in [found.get(name, (kind.code, kind.dimensions))]
        if (code, dimensions) != (kind.code, kind.dimensions)
    ]
    return ", ".join([*lacking, *unknown, *other])


def reserve(shards: Sequence[Shard]) -> tuple[Arrays, list[Arrays]]:
    """Memory for the arrays of all shards end to end, and the part of it that is each shard's."""
    whole: Arrays = {}
    places: list[Arrays] = [{} for _ in shards]
    for name, kind in ARRAYS.items():
        rows = [shard.shapes[name][0] for shard in shards]
        whole[name] = np.empty((sum(rows), *shards[0].shapes[name][1:]), kind.dtype)
        stop = 0
        for place, count in zip(places, rows, strict=True):
            start, stop = stop, stop + count
            place[name] = whole[name][start:stop]
    return whole, places


def read_into(place: Arrays, shard: Shard) -> None:
    """Read a shard's arrays into its place.

    Raises:
        ValueError: when they do not fit there, or the file is shorter than its header said.
        OSError: when it cannot be read.
    """
    wanted = {name: place[name].shape for name in shard.shapes}
    if shard.shapes != wanted:
        raise ValueError(f"its arrays {shard.shapes} do not continue those before it, {wanted}")
    with shard.path.open("rb") as file:
        file.seek(-sum(array.nbytes for array in place.values()), os.SEEK_END)
        for name in shard.shapes:
            target = place[name].reshape(-1).view(np.uint8)
            if file.readinto(target.data) != target.nbytes:
                raise ValueError("it ends early")
