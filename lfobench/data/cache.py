"""Shards of generated parts on disk: written whole or not at all, checked whenever they are read."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import platformdirs
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from lfobench.data.episodes import Episodes, concatenate
from lfobench.errors import UserError
from lfobench.files import replacing
from lfobench.plan.parts import PartSpecification

GENERATED = "generated"
ARRAYS = ("observations", "actions", "rewards", "lengths", "terminated")


def cache_folder() -> Path:
    """``LFOBENCH_CACHE``, or the platform's cache folder."""
    chosen = os.environ.get("LFOBENCH_CACHE")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("lfobench"))


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
    specification: PartSpecification

    @property
    def folder(self) -> Path:
        """Where the part's shards lie."""
        return self.root / GENERATED / self.specification.folder

    @property
    def _description(self) -> str:
        return json.dumps(self.specification.identity, sort_keys=True)

    def path(self, shard: int) -> Path:
        """File of one shard."""
        return self.folder / f"{shard:05d}.safetensors"

    def missing(self, transitions: int) -> list[int]:
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
        path = self.path(shard)
        remedy = f"Delete it and rebuild: rm {shlex.quote(str(path))} && {rebuild}"
        try:
            with safe_open(path, framework="numpy") as file:
                metadata = file.metadata() or {}
                episodes = Episodes(**{name: file.get_tensor(name) for name in ARRAYS})
        except FileNotFoundError as error:
            raise UserError(f"The dataset shard {path} is missing.", f"Build it: {rebuild}") from error
        except (SafetensorError, OSError, ValueError, IndexError, TypeError) as error:
            raise UserError(f"The dataset shard {path} is damaged ({error}).", remedy) from error
        found = fingerprint(episodes)
        expected = {
            "fingerprint": found,
            "specification": self._description,
            "shard": str(shard),
        }
        if metadata != expected:
            raise UserError(
                f"The dataset shard {path} was altered: its fingerprint or description does not match.", remedy
            )
        return episodes, found

    def load(self, transitions: int, rebuild: str) -> tuple[Episodes, str]:
        """The part's first `transitions` steps and the fingerprint of the shards that hold them.

        Raises:
            UserError: as `read` does.
        """
        shards = [self.read(shard, rebuild) for shard in range(self.specification.shards_for(transitions))]
        mark = _combined(transitions, [mark for _, mark in shards])
        return concatenate([episodes for episodes, _ in shards]).first_transitions(transitions), mark

    def declared_fingerprint(self, transitions: int) -> str | None:
        """What `load` would give as fingerprint if every shard is what it says; None where one cannot be read."""
        marks = []
        for shard in range(self.specification.shards_for(transitions)):
            try:
                with safe_open(self.path(shard), framework="numpy") as file:
                    marks.append((file.metadata() or {})["fingerprint"])
            except (SafetensorError, OSError, KeyError):
                return None
        return _combined(transitions, marks)


def _combined(transitions: int, marks: Sequence[str]) -> str:
    return hashlib.sha256(f"{transitions}:{','.join(marks)}".encode()).hexdigest()
