"""Parts that are read from files which others made: what decides their content, once a file is there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lfobench.contract.files import DataFile
from lfobench.contract.record import content_hash

READERS = 2
"""Grows whenever a reader makes other episodes of the same file."""

MOST_OF_A_NAME = 100
"""Characters; file systems take 255 with the rest."""


@dataclass(frozen=True)
class FilePart:
    """A file's episodes; the hash of what decides them names their folder in the cache.

    Attributes:
        name: what the file is called, e.g. ``hopper-random-v2``.
        sha256: of its bytes; empty of a file that is not here.
        horizon: steps after which an episode is cut, where the file does not say.
        columns: how many of an observation's columns are read; None reads all.
        keys: what an observation is made of; None leaves it to the file's layout.
        readers: version of the readers.
    """

    name: str
    sha256: str
    horizon: int
    columns: int | None = None
    keys: tuple[str, ...] | None = None
    readers: int = READERS

    @property
    def identity(self) -> dict[str, Any]:
        """As plain JSON data; neither the file's name nor where it lies is among it."""
        if not self.sha256:
            return {"absent": self.name}
        identity = {"sha256": self.sha256, "horizon": self.horizon, "columns": self.columns, "readers": self.readers}
        return identity if self.keys is None else {**identity, "keys": list(self.keys)}

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the identity."""
        return content_hash(self.identity)

    @property
    def level(self) -> str:
        """What tables and messages call the part."""
        return self.name

    @property
    def folder(self) -> str:
        """Folder name in the cache, e.g. ``hopper-random-v2-1a2b3c4d5e``."""
        return f"{self.name[:MOST_OF_A_NAME]}-{self.hash[:10]}"

    def shards_for(self, transitions: int | None) -> int:
        """A file is one shard, however much of it is read."""
        return 1


def file_part(file: DataFile, horizon: int) -> FilePart:
    """The part that a file is in an environment of that horizon."""
    return FilePart(file.name, file.sha256 or "", horizon, file.columns, file.keys)
