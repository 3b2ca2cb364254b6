"""Shards of generated parts on disk: written whole or not at all, checked whenever they are read."""

from __future__ import annotations

import glob
import hashlib
import json
import os
import shlex
import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from lfobench.cells.parts import MOST_OF_A_NAME, FilePart, Part
from lfobench.contract.episodes import Episodes
from lfobench.errors import UserError
from lfobench.files import cannot_delete, replacing

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
    """Missing, unknown and mistyped arrays of a shard, as a clause."""
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


GENERATED, IMPORTED = "generated", "imported"
READERS = 2


def fingerprint(episodes: Episodes) -> str:
    """SHA-256 over names, shapes, types and bytes of the arrays."""
    digest = hashlib.sha256()
    for name in ARRAYS:
        array = np.ascontiguousarray(getattr(episodes, name))
        digest.update(f"{name}:{array.dtype.str}:{array.shape};".encode())
        digest.update(array.data)
    return digest.hexdigest()


@dataclass(frozen=True)
class PartCache:
    """The shards of one part below `root`."""

    root: Path
    specification: Part

    @property
    def folder(self) -> Path:
        """Folder of the part's shards."""
        kind = IMPORTED if isinstance(self.specification, FilePart) else GENERATED
        return self.root / kind / self.specification.folder

    @property
    def _description(self) -> str:
        return json.dumps(self.specification.identity, sort_keys=True)

    def path(self, shard: int) -> Path:
        """File of one shard."""
        return self.folder / f"{shard:05d}.safetensors"

    def missing(self, transitions: int | None) -> list[int]:
        """Shards that a part of that many transitions still lacks."""
        try:
            return [
                shard for shard in range(self.specification.shards_for(transitions)) if not self.path(shard).exists()
            ]
        except OSError as error:
            raise UserError(
                f"Cannot look into the dataset cache {self.folder}: {error.strerror}.", "Set LFOBENCH_CACHE."
            ) from error

    def write(self, shard: int, episodes: Episodes) -> None:
        """Store one shard atomically."""
        metadata = {
            "fingerprint": fingerprint(episodes),
            "specification": self._description,
            "shard": str(shard),
        }
        with replacing(self.path(shard)) as temporary:
            save_file({name: np.ascontiguousarray(getattr(episodes, name)) for name in ARRAYS}, temporary, metadata)

    def read(self, shard: int, rebuild: str) -> tuple[Episodes, str]:
        """One shard and its fingerprint.

        Args:
            shard: its number.
            rebuild: the command that makes it again.

        Raises:
            UserError: when the file is missing, truncated, altered or of another shard, with its path and the remedy.
        """
        episodes, (mark,) = self._read([shard], rebuild)
        return episodes, mark

    def row_shapes(self, rebuild: str) -> dict[str, tuple[int, ...]]:
        """Shape of one row of each array, as the first shard's header has it.

        Raises:
            UserError: as `read` does.
        """
        with _damage_as_user_error(self.path(0), rebuild):
            return {name: shape[1:] for name, shape in open_shard(self.path(0)).shapes.items()}

    def load(self, transitions: int | None, rebuild: str) -> tuple[Episodes, str]:
        """The part's first `transitions` steps, or all of a recorded part, and the fingerprint of its shards.

        Raises:
            UserError: as `read` does.
        """
        episodes, marks = self._read(range(self.specification.shards_for(transitions)), rebuild)
        kept = episodes if transitions is None else episodes.first_transitions(transitions)
        return kept, _combined(transitions, marks)

    def check(self, transitions: int | None, rebuild: str) -> None:
        """Read the present shards among those that hold the first `transitions` steps.

        Raises:
            UserError: as `read` does, for the first that is damaged.
        """
        absent = set(self.missing(transitions))
        present = [shard for shard in range(self.specification.shards_for(transitions)) if shard not in absent]

        def read(shard: int) -> None:
            self.read(shard, rebuild)

        with ThreadPoolExecutor(READERS) as readers:
            list(readers.map(read, present))

    def _read(self, shards: Sequence[int], rebuild: str) -> tuple[Episodes, list[str]]:
        """Shards end to end and the fingerprint of each; every byte is read once, to where it stays."""
        description = self._description

        def opened(shard: int) -> Shard:
            path = self.path(shard)
            with _damage_as_user_error(path, rebuild):
                return open_shard(path)

        def checked(shard: int, file: Shard, place: Arrays) -> str:
            with _damage_as_user_error(file.path, rebuild):
                read_into(place, file)
                found = fingerprint(Episodes(**place))
            expected = {"fingerprint": found, "specification": description, "shard": str(shard)}
            if file.metadata != expected:
                raise UserError(
                    f"The dataset shard {file.path} was altered: its fingerprint or description does not match.",
                    _remedy(file.path, rebuild),
                )
            return found

        files = [opened(shard) for shard in shards]
        whole, places = reserve(files)
        # Most of the time goes into hashing, which leaves the interpreter to other threads.
        with ThreadPoolExecutor(READERS) as readers:
            marks = list(readers.map(checked, shards, files, places))
        return Episodes(**whole), marks

    def declared_fingerprint(self, transitions: int | None) -> str | None:
        """Fingerprint that `load` would give by the shards' headers; None where one cannot be read."""
        marks = []
        for shard in range(self.specification.shards_for(transitions)):
            try:
                with safe_open(self.path(shard), framework="numpy") as file:
                    marks.append((file.metadata() or {})["fingerprint"])
            except (SafetensorError, OSError, KeyError):
                return None
        return _combined(transitions, marks)


def forget_imports(root: Path, name: str, sha256: str) -> None:
    """Delete all shards imported from a file, whatever columns and horizon they were read with.

    Raises:
        UserError: the disk refuses.
    """
    for folder in (root / IMPORTED).glob(f"{glob.escape(name[:MOST_OF_A_NAME])}-*"):
        made_of = None
        with suppress(SafetensorError, OSError, ValueError, KeyError):  # a damaged shard has no readable origin
            made_of = json.loads(open_shard(folder / "00000.safetensors").metadata["specification"])["sha256"]
        if made_of == sha256:
            try:
                shutil.rmtree(folder)
            except OSError as error:
                raise cannot_delete(folder, error) from error


def _combined(transitions: int | None, marks: Sequence[str]) -> str:
    amount = "all" if transitions is None else transitions
    return hashlib.sha256(f"{amount}:{','.join(marks)}".encode()).hexdigest()


@contextmanager
def _damage_as_user_error(path: Path, rebuild: str) -> Iterator[None]:
    """Errors in reading the shard at `path` become user errors with a remedy."""
    try:
        yield
    except FileNotFoundError as error:
        raise UserError(f"The dataset shard {path} is missing.", f"Build it: {rebuild}") from error
    except (SafetensorError, OSError, ValueError) as error:
        raise UserError(f"The dataset shard {path} is damaged ({error}).", _remedy(path, rebuild)) from error


def _remedy(path: Path, rebuild: str) -> str:
    return f"Delete it and rebuild: rm {shlex.quote(str(path))} && {rebuild}"
