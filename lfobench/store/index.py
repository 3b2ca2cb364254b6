"""What this machine has already verified of a folder of records, so that reading thousands of them again is quick.

An index holds, for every record that was read, verified and understood: the file's size and modification time, the
fields that views select by, and the numbers of its evaluations. A file whose size and time are unchanged is not opened
again. An index is only a cache: it is rebuilt from the records whenever it is missing, damaged or of another version,
and it lies in this user's cache folder, never beside the records, which may come from somebody else.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.record import Record, content_hash
from lfobench.errors import UserError
from lfobench.files import cache_folder, replacing

VERSION = 1


@dataclass(frozen=True)
class Stamp:
    """By which a file is known again."""

    size: int
    modified: int

    @classmethod
    def of(cls, path: Path) -> Stamp:
        """The stamp of a file as it is now; `modified` in nanoseconds."""
        found = path.stat()
        return cls(found.st_size, found.st_mtime_ns)


@dataclass(frozen=True)
class Digest:
    """What views over many records need of one of them.

    Attributes:
        stamp: of the file when it was verified.
        identity_hash: names the run.
        outcome_hash: of everything measured; equal for copies.
        fields: what is the same for all of the record's evaluations.
        steps: gradient step of every evaluation ``[E]``.
        episodes: episodes of every evaluation ``[E]``.
        returns: raw return of every episode, evaluation after evaluation ``[N]``.
        lengths: steps of every episode ``[N]``.
    """

    stamp: Stamp
    identity_hash: str
    outcome_hash: str
    fields: Mapping[str, Any]
    steps: NDArray[np.int64]
    episodes: NDArray[np.int64]
    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]


def digest(record: Record, stamp: Stamp) -> Digest:
    """The digest of a verified record."""
    identity, labels = record.identity, record.labels
    evaluations = record.evaluations
    return Digest(
        stamp=stamp,
        identity_hash=record.identity_hash,
        outcome_hash=content_hash(record.model_dump(mode="json", exclude={"provenance", "warnings", "labels"})),
        fields={
            "suite": labels.suite,
            "group": labels.group,
            "row": labels.row,
            "task": record.task,
            "method": record.method,
            "method_version": identity["method_version"],
            "preset": identity["preset"],
            "set": json.dumps(identity.get("set", {}), sort_keys=True),
            "source": identity["source"],
            "protocol": identity["protocol"]["name"],
            "protocol_steps": identity["protocol"]["steps"],
            "environment": identity["environment"]["id"],
            "precision": identity.get("precision", "float32"),
            "seed": record.seed,
            "status": record.status,
            "diverged_at": record.diverged_at,
            "random_return": identity["environment"]["random_return"],
            "expert_return": identity["environment"]["expert_return"],
        },
        steps=np.array([evaluation.step for evaluation in evaluations], dtype=np.int64),
        episodes=np.array([len(evaluation.returns) for evaluation in evaluations], dtype=np.int64),
        returns=np.array([value for evaluation in evaluations for value in evaluation.returns], dtype=np.float64),
        lengths=np.array([value for evaluation in evaluations for value in evaluation.lengths], dtype=np.int64),
    )


def index_path(root: Path) -> Path:
    """Where the index of a folder lies."""
    name = hashlib.sha256(str(root.resolve()).encode()).hexdigest()[:24]
    return cache_folder() / "index" / f"{name}.npz"


def read_index(root: Path) -> dict[str, Digest]:
    """Digests by path below `root`; empty where there is no index that can be used."""
    try:
        with np.load(index_path(root), allow_pickle=False) as arrays:
            header = json.loads(arrays["header"].tobytes())
            if header["version"] != VERSION:
                return {}
            return dict(_unpacked(header["records"], {name: arrays[name] for name in _ARRAYS}))
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        return {}


def write_index(root: Path, digests: Mapping[str, Digest]) -> None:
    """Keep the digests, by path below `root`, for the next time; a cache that cannot be written is done without."""
    header = {
        "version": VERSION,
        "records": [
            {
                "path": path,
                "stamp": [each.stamp.size, each.stamp.modified],
                "identity_hash": each.identity_hash,
                "outcome_hash": each.outcome_hash,
                "fields": dict(each.fields),
                "evaluations": len(each.steps),
                "episodes": len(each.returns),
            }
            for path, each in digests.items()
        ],
    }
    arrays = {name: _joined([getattr(each, name) for each in digests.values()], kind) for name, kind in _ARRAYS.items()}
    with suppress(UserError), replacing(index_path(root)) as temporary, temporary.open("wb") as file:
        np.savez(file, header=np.frombuffer(json.dumps(header).encode(), dtype=np.uint8), **arrays)


_ARRAYS: dict[str, type[np.int64] | type[np.float64]] = {
    "steps": np.int64,
    "episodes": np.int64,
    "returns": np.float64,
    "lengths": np.int64,
}


def _joined(parts: Sequence[NDArray[Any]], kind: type[np.int64] | type[np.float64]) -> NDArray[Any]:
    return np.concatenate([np.empty(0, kind), *parts])


def _unpacked(records: Sequence[Mapping[str, Any]], arrays: Mapping[str, NDArray[Any]]) -> list[tuple[str, Digest]]:
    if {name: array.dtype for name, array in arrays.items()} != {
        name: np.dtype(kind) for name, kind in _ARRAYS.items()
    }:
        raise ValueError("the index holds arrays of other types")
    found = []
    evaluation = episode = 0
    for each in records:
        evaluations = slice(evaluation, evaluation := evaluation + each["evaluations"])
        episodes = slice(episode, episode := episode + each["episodes"])
        found.append(
            (
                each["path"],
                Digest(
                    Stamp(*each["stamp"]),
                    each["identity_hash"],
                    each["outcome_hash"],
                    each["fields"],
                    arrays["steps"][evaluations],
                    arrays["episodes"][evaluations],
                    arrays["returns"][episodes],
                    arrays["lengths"][episodes],
                ),
            )
        )
    if (evaluation, evaluation, episode, episode) != tuple(len(arrays[name]) for name in _ARRAYS):
        raise ValueError("the index does not add up")
    return found
