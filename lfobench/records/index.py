"""Index of the verified records of a folder, so that reading thousands of them again is quick.

It holds, for every record that was read and verified: the stamp of its file, the fields that views select by, and the
numbers of its evaluations. An unchanged file is not opened again. The index is only a cache: it is rebuilt from the
records whenever it is missing, damaged or of another version, and it lies in this user's cache folder, never next to
the records, which may be from another user.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, NonNegativeInt

from lfobench.errors import UserError
from lfobench.files import cache_folder, replacing
from lfobench.record import Metrics, Record, Status, Warning
from lfobench.text import canonical_json

COARSEST_CLOCK = 2_000_000_000
"""Nanoseconds between two times that every file system tells apart."""

Whole = Annotated[int, Field(ge=-(2**63), lt=2**63)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Stamp(NamedTuple):
    """Size and times of a file, which identify its content; times in nanoseconds.

    The time of the last change is the system's own: copying and unpacking tools restore `modified`, but not `changed`.
    """

    size: int
    modified: int
    changed: int

    @classmethod
    def of(cls, path: Path) -> Stamp:
        """The stamp of a file as it is now."""
        found = path.stat()
        return cls(found.st_size, found.st_mtime_ns, found.st_ctime_ns)

    @property
    def settled(self) -> bool:
        """True if any later edit gives another stamp; one within the same tick of the clock might not."""
        return time.time_ns() - self.modified > COARSEST_CLOCK


class RunFields(_Model):
    """Fields shared by all evaluations of a record; `set` and `tuned` are canonical JSON."""

    suite: str
    group: str
    row: str
    task: str
    method: str
    method_version: Whole
    preset: str
    set: str
    tuned: str
    source: str
    protocol: str
    protocol_steps: Whole
    environment: str
    precision: str
    seed: Whole
    status: Status
    random_return: FiniteFloat
    expert_return: FiniteFloat


@dataclass(frozen=True)
class Digest:
    """Summary of one record, for views over many.

    Attributes:
        stamp: of the file before it was verified.
        identity_hash: names the run.
        outcome_hash: of everything measured; equal for copies.
        fields: what is the same for all of the record's evaluations.
        steps: gradient step of every evaluation ``[E]``; where there is none, the step of the divergence ``[1]``.
        episodes: episodes of every evaluation ``[E]``; where there is none, 0 ``[1]``.
        returns: raw return of every episode, evaluation after evaluation ``[N]``.
        lengths: steps of every episode ``[N]``.
        bound_warning: of a run with a score beyond all bounds, whose evaluations end before that.
    """

    stamp: Stamp
    identity_hash: str
    outcome_hash: str
    fields: RunFields
    steps: NDArray[np.int64]
    episodes: NDArray[np.int64]
    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    bound_warning: Warning | None = None


def digest(record: Record, stamp: Stamp) -> Digest:
    """The digest of a verified record.

    Raises:
        ValueError: it holds values that no run leaves: episodes with a return and no length, a number beyond 64 bits.
    """
    arrays = _arrays(record)
    outcomes = [each.outcomes for each in record.evaluations]
    measured = [record.status, record.diverged_at, len(arrays[0]), len(arrays[2]), outcomes]
    further = None if record.further is None else record.further.model_dump(mode="json")
    outcome = hashlib.sha256(canonical_json([*measured, further]).encode())
    for part in arrays:
        outcome.update(part.tobytes())
    _add_metrics(outcome, record.metrics)
    bounded = record.bounded()
    bound_warning = None
    if bounded is not record:
        arrays, bound_warning = _arrays(bounded), bounded.warnings[-1]
    return Digest(stamp, record.identity_hash, outcome.hexdigest(), run_fields(bounded), *arrays, bound_warning)


def run_fields(record: Record) -> RunFields:
    """Fields of the run behind a record.

    Raises:
        ValueError: a number is beyond 64 bits.
    """
    identity, labels = record.identity, record.labels
    return RunFields(
        suite=labels.suite,
        group=labels.group,
        row=labels.row,
        task=record.task,
        method=record.method,
        method_version=identity["method_version"],
        preset=identity["preset"],
        set=canonical_json(identity["set"]),
        tuned=canonical_json(identity.get("tuned", {})),
        source=identity["source"],
        protocol=identity["protocol"]["name"],
        protocol_steps=identity["protocol"]["steps"],
        environment=identity["environment"]["id"],
        precision=identity.get("precision", "float32"),
        seed=record.seed,
        status=record.status,
        random_return=identity["environment"]["random_return"],
        expert_return=identity["environment"]["expert_return"],
    )


def _arrays(record: Record) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Steps, episodes, returns and lengths, as of `Digest`."""
    evaluations = record.evaluations
    if not evaluations and record.diverged_at is None:
        raise ValueError("it holds no evaluation and does not say when it diverged")
    try:
        steps = np.array([each.step for each in evaluations] if evaluations else [record.diverged_at], np.int64)
        lengths = np.array([length for each in evaluations for length in each.lengths], np.int64)
    except OverflowError as error:
        raise ValueError("a step or a length needs more than 64 bits") from error
    episodes = np.array([len(each.returns) for each in evaluations] or [0], np.int64)
    returns = np.array([value for each in evaluations for value in each.returns], np.float64)
    return steps, episodes, returns, lengths


def _add_metrics(outcome: hashlib._Hash, metrics: Sequence[Metrics]) -> None:
    """Metrics into the hash, numbers as bytes: as text they would take longer than the rest of a digest."""
    rows = [(each.stage, each.step, sorted(each.values)) for each in metrics]
    outcome.update(canonical_json(rows).encode())
    values = [each.values[name] for each, (_, _, names) in zip(metrics, rows, strict=True) for name in names]
    outcome.update(np.array(values, np.float64).tobytes())  # null becomes NaN, which no record holds


def index_path(root: Path) -> Path:
    """Path of a folder's index."""
    name = hashlib.sha256(os.fsencode(root.resolve())).hexdigest()[:24]
    return cache_folder() / "index" / f"{name}.npz"


_ARRAYS: dict[str, type[np.int64] | type[np.float64]] = {
    "steps": np.int64,
    "episodes": np.int64,
    "returns": np.float64,
    "lengths": np.int64,
}


class _Entry(_Model):
    stamp: tuple[int, int, int]
    identity_hash: str
    outcome_hash: str
    fields: RunFields
    evaluations: NonNegativeInt
    episodes: NonNegativeInt
    explosion: Warning | None


class _Header(_Model):
    version: Literal[3] = 3
    records: list[_Entry]


def read_index(root: Path) -> dict[str, Digest]:
    """Digests by path below `root`; empty where there is no usable index."""
    try:
        with index_path(root).open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            header = _Header.model_validate_json(arrays["header"].tobytes())
            paths = [os.fsdecode(path) for path in arrays["paths"].tobytes().split(b"\0")]
            digests = _unpacked(header.records, {name: arrays[name] for name in _ARRAYS})
        return dict(zip(paths, digests, strict=True))
    except Exception:  # a damaged archive raises a dozen kinds of errors; then the records are read again
        return {}


def write_index(root: Path, digests: Mapping[str, Digest]) -> None:
    """Store the digests by path below `root`; a cache that cannot be written is skipped."""
    found = digests.values()
    header = _Header(
        records=[
            _Entry(
                stamp=each.stamp,
                identity_hash=each.identity_hash,
                outcome_hash=each.outcome_hash,
                fields=each.fields,
                evaluations=len(each.steps),
                episodes=len(each.returns),
                explosion=each.bound_warning,
            )
            for each in found
        ]
    )
    arrays = {name: joined([getattr(each, name) for each in found], kind) for name, kind in _ARRAYS.items()}
    paths = b"\0".join(map(os.fsencode, digests))
    with suppress(UserError), replacing(index_path(root)) as temporary, temporary.open("wb") as file:
        np.savez(file, header=_bytes(header.model_dump_json().encode()), paths=_bytes(paths), **arrays)


def joined(parts: Sequence[NDArray[Any]], kind: type[np.int64] | type[np.float64]) -> NDArray[Any]:
    """Arrays end to end; an empty array of no parts."""
    return np.concatenate([np.empty(0, kind), *parts])


def _bytes(content: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(content, np.uint8)


def _unpacked(entries: Sequence[_Entry], arrays: Mapping[str, NDArray[Any]]) -> list[Digest]:
    evaluations = np.cumsum([0, *(each.evaluations for each in entries)], dtype=np.int64)
    episodes = np.cumsum([0, *(each.episodes for each in entries)], dtype=np.int64)
    sizes = {"steps": evaluations[-1], "episodes": evaluations[-1], "returns": episodes[-1], "lengths": episodes[-1]}
    if any(arrays[name].dtype != kind or arrays[name].shape != (sizes[name],) for name, kind in _ARRAYS.items()):
        raise ValueError("the index holds arrays of other types or sizes")
    before = np.concatenate([[0], np.cumsum(arrays["episodes"])])
    if (arrays["episodes"] < 0).any() or (before[evaluations] != episodes).any():
        raise ValueError("the index does not add up")
    return [
        Digest(
            Stamp(*each.stamp),
            each.identity_hash,
            each.outcome_hash,
            each.fields,
            arrays["steps"][first:last],
            arrays["episodes"][first:last],
            arrays["returns"][start:end],
            arrays["lengths"][start:end],
            each.explosion,
        )
        for each, first, last, start, end in zip(
            entries, evaluations, evaluations[1:], episodes, episodes[1:], strict=False
        )
    ]
