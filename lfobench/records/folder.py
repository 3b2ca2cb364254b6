"""A folder of records: ``records/<task>/<method>-<preset>-seed<k>-<hash>.json`` below the output folder."""

from __future__ import annotations

import gc
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import count, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ValidationError

from lfobench.errors import UserError
from lfobench.files import Held, locked, read_within, remove_leftovers, write_text
from lfobench.record import MOST_BYTES, SCHEMA, Failure, Record, Warning, first_problem
from lfobench.records.sealed import read_sealed, write_sealed
from lfobench.text import canonical_json, content_hash

if TYPE_CHECKING:
    from lfobench.cells.cell import Run

FAILURE_SUFFIX = ".failure"

TUNING = "tuning"
"""Folder below an output folder where ``lfobench tune`` keeps its trials, whose records are no results."""

ASIDE = "aside"
"""Folder below an output folder where ``lfobench run --rerun`` keeps what it trains anew, in a folder per command."""


@dataclass(frozen=True)
class RecordFolder:
    """The output folder of ``lfobench run``."""

    root: Path

    @property
    def records(self) -> Path:
        """Folder of the records."""
        return self.root / "records"

    def path(self, run: Run) -> Path:
        """Path of a run's record."""
        cell = run.cell
        name = f"{cell.method.name}-{cell.preset}-seed{run.seed}-{run.identity_hash[:12]}.json"
        return self.records / safe_name(cell.task.name) / safe_name(name)

    @property
    def checkpoints(self) -> Path:
        """Folder of the checkpoints of unfinished runs."""
        return self.root / "checkpoints"

    def checkpoint(self, run: Run) -> Path:
        """The checkpoint of a run."""
        return self.checkpoints / f"{self.path(run).stem}.safetensors"

    def lock(self, run: Run) -> Path:
        """Lock of the process that trains a run."""
        return self.checkpoints / f"{self.path(run).stem}.lock"

    def failure(self, run: Run) -> Path:
        """Report of a crashed run; its own suffix separates it from records."""
        return self.root / "failures" / safe_name(run.cell.task.name) / f"{self.path(run).stem}{FAILURE_SUFFIX}"

    def policy(self, record: Record) -> Path:
        """The trained policy of a run; `path` gives the record the same name."""
        name = f"{record.method}-{record.identity['preset']}-seed{record.seed}-{record.identity_hash[:12]}"
        return self.root / "policies" / safe_name(record.task) / safe_name(f"{name}.safetensors")

    def find(self, run: Run) -> Record | None:
        """The run's record, bounded (see `Record.bounded`); None where it is missing or damaged."""
        path = self.path(run)
        try:
            if not path.exists():
                return None
        except OSError as error:
            raise UserError(f"Cannot look into {path.parent}: {error.strerror}.", "Choose another --out.") from error
        record = read_record(path)
        return record.bounded() if isinstance(record, Record) and record.identity_hash == run.identity_hash else None

    def write(self, run: Run, record: Record) -> Path:
        """Store a record atomically."""
        path = self.path(run)
        write_sealed(path, record.model_dump(mode="json"))
        return path

    def remove_leftovers(self) -> None:
        """Delete temporary files of killed runs in this folder's own subfolders."""
        for own in ("records", "policies", "checkpoints", "failures"):
            remove_leftovers(self.root / own)

    def read_all(self) -> RecordsRead:
        """Every result below the folder, and a warning for every JSON file there that is not one.

        A run leaves one record. Copies of it, as in two merged folders, count once; two records of one run with
        different measurements do not count at all. A run with scores beyond all bounds counts as diverged, with a
        warning.

        Raises:
            UserError: when the folder does not exist or cannot be looked into.
        """
        found: dict[str, list[tuple[Path, Record]]] = {}
        read = RecordsRead()
        with _no_garbage_collection():
            for path in self.files():
                outcome = read_record(path)
                if isinstance(outcome, Warning):
                    read.warnings.append(outcome)
                elif is_trial(outcome):
                    read.warnings.append(warning_of_trial(path))
                else:
                    found.setdefault(outcome.identity_hash, []).append((path, outcome))
        for identity, copies in found.items():
            paths = [path for path, _ in copies]
            contradict = any(_outcome(record) != _outcome(copies[0][1]) for _, record in copies)
            read.warnings += warnings_of_copies(paths, contradict)
            if contradict:
                read.contradicted[identity] = paths
            else:
                read.records.append(copies[0][1].bounded())
                read.warnings += read.records[-1].warnings[len(copies[0][1].warnings) :]
        return read

    def files(self) -> list[Path]:
        """JSON files below the folder, in order, without trials and records set aside.

        Raises:
            UserError: when the folder does not exist or cannot be looked into.
        """
        try:
            if self.root.exists() and not self.root.is_dir():
                raise UserError(f"{self.root} is not a folder.", "Choose another --out.")
            if not self.root.is_dir():
                raise UserError(f"No folder {self.root}.", "Run 'lfobench run' first, or name another with --out.")
            return self.found("*.json")
        except OSError as error:
            raise UserError(f"Cannot look into {self.root}: {error.strerror}.", "Choose another --out.") from error

    def found(self, pattern: str) -> list[Path]:
        """Files below the folder that match, in order, without trials and files set aside."""
        return sorted(path for path in self.root.rglob(pattern) if not self._apart(path))

    def _apart(self, path: Path) -> bool:
        # Below `records`, a folder of that name holds the results of a task of that name.
        below = ("", *path.parts[len(self.root.parts) :])
        return any(folder in (TUNING, ASIDE) and above != "records" for above, folder in pairwise(below))

    def set_aside(self, runs: Sequence[Run]) -> None:
        """Move all files of runs to a new folder below `ASIDE`, which no view reads.

        Files are renamed, a record after its checkpoint and policy: a kill in between loses nothing, and no record is
        moved while its policy could still be overwritten by another training.

        Raises:
            UserError: another process trains one of the runs, or the disk refuses.
        """
        if not runs or not self.root.exists():
            return
        # At its own path an unreadable record moves, too; copies may be elsewhere.
        records = {run.identity_hash: [self.path(run)] for run in runs}
        for path in self.files():
            record = read_record(path)
            if isinstance(record, Record) and path not in records.get(record.identity_hash, [path]):
                records[record.identity_hash].append(path)
        aside = self._new_aside()
        try:
            for run in runs:
                self.checkpoints.mkdir(exist_ok=True)
                with locked(self.lock(run), "--out"):
                    belonging = [self.checkpoint(run), self._policy(run), self.failure(run)]
                    for path in (*belonging, *records[run.identity_hash]):
                        if path.exists():
                            target = aside / path.relative_to(self.root)
                            target.parent.mkdir(parents=True, exist_ok=True)
                            path.rename(target)
        except Held as error:
            raise UserError(f"Another process trains {run.label}.", "Wait for it, or stop it.") from error
        except OSError as error:
            raise UserError(f"Cannot set {run.label} aside: {error}.", "Free the folder, or choose another.") from error

    def _policy(self, run: Run) -> Path:
        return (self.root / "policies" / self.path(run).relative_to(self.records)).with_suffix(".safetensors")

    def _new_aside(self) -> Path:
        stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
        places = (self.root / ASIDE / (stamp if number == 1 else f"{stamp}-{number}") for number in count(1))
        return next(place for place in places if not place.exists())

    def earlier(self, run: Run) -> list[Path]:
        """Records of a run that were set aside earlier."""
        return sorted((self.root / ASIDE).glob(f"*/{self.path(run).relative_to(self.root)}"))


@dataclass
class RecordsRead:
    """Records of a folder.

    Attributes:
        records: one per run.
        warnings: about skipped files and copies.
        contradicted: identity hash to files, where the records of one run have different measurements.
    """

    records: list[Record] = field(default_factory=list)
    warnings: list[Warning] = field(default_factory=list)
    contradicted: dict[str, list[Path]] = field(default_factory=dict)

    def without(self, runs: Sequence[Run]) -> RecordsRead:
        """The same without the records of these runs."""
        gone = {run.identity_hash for run in runs}
        kept = [record for record in self.records if record.identity_hash not in gone]
        contradicted = {identity: paths for identity, paths in self.contradicted.items() if identity not in gone}
        return RecordsRead(kept, self.warnings, contradicted)


def read_folder(out: Path) -> RecordsRead:
    """The records of an output folder; none where it does not exist yet.

    Raises:
        UserError: it cannot be looked into.
    """
    try:
        absent = not out.exists()
    except OSError as error:
        raise UserError(f"Cannot look into {out}: {error.strerror}.", "Choose another --out.") from error
    return RecordsRead() if absent else RecordFolder(out).read_all()


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Garbage collection off: traversing thousands of live records takes a quarter of the time of reading them."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _outcome(record: Record) -> tuple[object, ...]:
    return record.status, record.diverged_at, record.evaluations, record.further, record.metrics


def is_trial(record: Record) -> bool:
    """True for a record of a hyperparameter search, whose starts are not those of the tests."""
    return bool(record.identity.get("starts", "evaluation") != "evaluation")


def warning_of_trial(path: Path) -> Warning:
    """Warning about a trial's record among results."""
    remedy = "Name the folder of the results with --out."
    return Warning(what=f"{path} is a trial of 'lfobench tune', no result, and was skipped.", remedy=remedy)


def warnings_of_copies(paths: Sequence[Path], contradict: bool) -> list[Warning]:
    """Warning about several files that are records of one run; none for a single file."""
    if len(paths) == 1:
        return []
    names = ", ".join(map(str, paths))
    if contradict:
        what = f"{names} are records of one run and differ in what they measured, so none of them counts."
        return [Warning(what=what, remedy="Keep the one you trust; the provenance in each says what made it.")]
    return [Warning(what=f"{names} are copies of one record, which counts once.", remedy="Remove all but one.")]


def read_record(path: Path) -> Record | Warning:
    """One record, or a warning with the reason why the file is not one."""
    try:
        sealed = read_sealed(path)
        content = sealed.content
        if isinstance(content, dict) and content.get("schema_version", SCHEMA) != SCHEMA:
            cause = f"its schema is {content['schema_version']}, this version reads {SCHEMA}"
            return Warning(what=f"{path} was skipped: {cause}.", remedy="Run it again, or use the version it is from.")
        record = Record.model_validate(content)
        intact = sealed.intact
    except (OSError, ValueError, RecursionError) as error:
        cause = first_problem(error) if isinstance(error, ValidationError) else str(error)
        return Warning(what=f"{path} is not a record of lfobench and was skipped ({cause}).", remedy="Move it away.")
    if not intact or content_hash(record.identity) != record.identity_hash:
        what = f"{path} was skipped: it does not match its seal, so it was edited after it was written."
        return Warning(what=what, remedy="Delete it and run again.")
    return record


Kept = TypeVar("Kept", Record, Failure)


def select(records: Sequence[Kept], **wanted: str | int | None) -> list[Kept]:
    """Records or failures whose ``source``, ``protocol``, ``steps``, ``suite`` or ``preset`` is the wanted one.

    None keeps all.
    """
    found: dict[str, Callable[[Record | Failure], object]] = {
        "source": lambda record: record.identity["source"],
        "protocol": lambda record: record.identity["protocol"]["name"],
        "steps": lambda record: record.identity["protocol"]["steps"],
        "suite": lambda record: record.labels.suite,
        "preset": lambda record: record.identity["preset"],
    }
    return [
        record
        for record in records
        if all(value is None or found[name](record) == value for name, value in wanted.items())
    ]


def safe_name(name: str) -> str:
    """A name as part of a path on any system."""
    return re.sub(r"[^A-Za-z0-9._+-]", "_", name)


def write_failure(folder: RecordFolder, run: Run, error: str, traceback: str, place: Sequence[str] = ()) -> Path:
    """Store a report of a crashed run, in place of an earlier one."""
    path = folder.failure(run)
    failure = Failure(
        identity_hash=run.identity_hash,
        identity=run.identity,
        labels=run.cell.labels,
        error=error,
        place=list(place),
        traceback=traceback.splitlines(),
    )
    write_text(path, failure.model_dump_json(indent=1) + "\n")
    return path


def read_failures(folder: RecordFolder, records: list[Record]) -> tuple[list[Failure], list[Warning]]:
    """Crashed runs without a later record, and a warning for every file that is no report of a crash."""
    done = {record.identity_hash for record in records}
    failures, warnings = [], []
    for path in folder.found(f"*{FAILURE_SUFFIX}"):
        try:
            failure = Failure.model_validate_json(read_within(path, MOST_BYTES))
        except (OSError, ValueError):
            what = f"{path} is no report of a failed run and was skipped."
            warnings.append(Warning(what=what, remedy="Delete it; the run is tried again anyway."))
            continue
        if failure.identity_hash not in done:
            failures.append(failure)
    return failures, warnings


@dataclass(frozen=True)
class Explanation:
    """The answer for one run.

    Attributes:
        run: its label.
        identity: hash of the identity that was looked for.
        reused: whether a record with that identity is there.
        headline: the decision as a sentence.
        differences: fields in which the nearest record differs, ``field: record's -> wanted``; of a reused record
            only its data, where the cache now holds other data under the same description.
        aside: earlier records of the run, which ``--rerun`` trained anew.
    """

    run: str
    identity: str
    reused: bool
    headline: str
    differences: tuple[str, ...]
    aside: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The answer as JSON data, without the headline."""
        return {
            "run": self.run,
            "identity": self.identity,
            "reused": self.reused,
            "differences": list(self.differences),
            "aside": list(self.aside),
        }


def explain(run: Run, records: Sequence[Record], data: Mapping[str, str], aside: Sequence[Path] = ()) -> Explanation:
    """Compare a run with the records of its method and task.

    Args:
        run: the requested run.
        records: the present ones.
        data: fingerprints of the run's cached data, by part; without missing parts.
        aside: earlier records of the run.
    """
    found = _compared(run, records, data)
    if not aside:
        return found
    places = tuple(map(str, aside))
    return replace(found, headline=f"{found.headline} (trained before, set aside: {', '.join(places)})", aside=places)


def _compared(run: Run, records: Sequence[Record], data: Mapping[str, str]) -> Explanation:
    short = run.identity_hash[:12]
    same = next((record for record in records if record.identity_hash == run.identity_hash), None)
    if same is not None:
        made_from = same.provenance.get("data_fingerprints", {})
        both = made_from.keys() & data.keys()
        found = tuple(
            differences(
                {part: made_from[part] for part in both}, {part: data[part] for part in both}, "data_fingerprints."
            )
        )
        headline = f"{run.label}: reused, identity {short}"
        if found:
            headline += "; made from other data than this machine's cache holds"
        return Explanation(run.label, run.identity_hash, True, headline, found)
    related = [
        record for record in records if record.method == run.cell.method.name and record.task == run.cell.task.name
    ]
    if not related:
        headline = f"{run.label}: will run, no record of this method on this task"
        return Explanation(run.label, run.identity_hash, False, headline, ())
    nearest = min(related, key=lambda record: (len(list(differences(record.identity, run.identity))), record.seed))
    found = tuple(differences(nearest.identity, run.identity))
    headline = f"{run.label}: will run, identity {short}; the nearest record {nearest.identity_hash[:12]} differs in"
    return Explanation(run.label, run.identity_hash, False, headline, found)


def differences(record: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """``field: record's -> wanted`` for every leaf in which two identities differ."""
    for name in sorted({*record, *wanted}):
        one, two = record.get(name), wanted.get(name)
        if isinstance(one, Mapping) and isinstance(two, Mapping):
            yield from differences(one, two, f"{prefix}{name}.")
        elif (name in record) != (name in wanted) or canonical_json(one) != canonical_json(two):
            yield f"{prefix}{name}: {_text(name, record)} -> {_text(name, wanted)}"


def _text(field: str, identity: Mapping[str, Any]) -> str:
    return canonical_json(identity[field]) if field in identity else "absent"
