"""Shards of generated parts on disk: written whole or not at all, checked whenever they are read."""

from __future__ import annotations

import glob
import hashlib
import json
import shlex
import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from lfobench.contract.episodes import Episodes
from lfobench.data.shard import ARRAYS, Arrays, Shard, open_shard, read_into, reserve
from lfobench.errors import UserError
from lfobench.files import cannot_delete, replacing
from lfobench.plan.file_parts import MOST_OF_A_NAME, FilePart
from lfobench.plan.parts import Part

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
        """Where the part's shards lie."""
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
            UserError: when the file is missing, truncated, altered or of another shard, naming it and the way out.
        """
        episodes, (mark,) = self._read([shard], rebuild)
        return episodes, mark

    def row_shapes(self, rebuild: str) -> dict[str, tuple[int, ...]]:
        """Shape of one row of each array, as the first shard's header has it.

        Raises:
            UserError: as `read` does.
        """
        with _damage_named(self.path(0), rebuild):
            return {name: shape[1:] for name, shape in open_shard(self.path(0)).shapes.items()}

    def load(self, transitions: int | None, rebuild: str) -> tuple[Episodes, str]:
        """The part's first `transitions` steps, or a recorded part whole, and the fingerprint of its shards.

        Raises:
            UserError: as `read` does.
        """
        episodes, marks = self._read(range(self.specification.shards_for(transitions)), rebuild)
        kept = episodes if transitions is None else episodes.first_transitions(transitions)
        return kept, _combined(transitions, marks)

    def check(self, transitions: int | None, rebuild: str) -> None:
        """Read, of the shards that hold the first `transitions` steps, those that are there.

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
            with _damage_named(path, rebuild):
                return open_shard(path)

        def checked(shard: int, file: Shard, place: Arrays) -> str:
            with _damage_named(file.path, rebuild):
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
        """What `load` would give as fingerprint if every shard is what it says; None where one cannot be read."""
        marks = []
        for shard in range(self.specification.shards_for(transitions)):
            try:
                with safe_open(self.path(shard), framework="numpy") as file:
                    marks.append((file.metadata() or {})["fingerprint"])
            except (SafetensorError, OSError, KeyError):
                return None
        return _combined(transitions, marks)


def forget_imports(root: Path, name: str, sha256: str) -> None:
    """Delete the shards that were made of a file, whichever of its columns and horizons they hold.

    Raises:
        UserError: the disk refuses.
    """
    for folder in (root / IMPORTED).glob(f"{glob.escape(name[:MOST_OF_A_NAME])}-*"):
        made_of = None
        with suppress(SafetensorError, OSError, ValueError, KeyError):  # a damaged shard does not say it
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
def _damage_named(path: Path, rebuild: str) -> Iterator[None]:
    """What goes wrong in reading the shard at `path`, as an error with the way out."""
    try:
        yield
    except FileNotFoundError as error:
        raise UserError(f"The dataset shard {path} is missing.", f"Build it: {rebuild}") from error
    except (SafetensorError, OSError, ValueError) as error:
        raise UserError(f"The dataset shard {path} is damaged ({error}).", _remedy(path, rebuild)) from error


def _remedy(path: Path, rebuild: str) -> str:
    return f"Delete it and rebuild: rm {shlex.quote(str(path))} && {rebuild}"
