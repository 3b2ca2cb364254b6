"""Data files on this machine: the path of each, and its hash when it was first used.

Below the cache, ``files/<source>/<name>.json`` is the note of one file and, where it was downloaded, ``<name>.hdf5``
is the file itself. An adopted file stays in its place. The hash is recorded on first use and compared ever after; the
file is hashed again only when its size or times have changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, ValidationError

from lfobench.cells.sources import OWN
from lfobench.contract.environment import Environment
from lfobench.contract.suite import DataFile, Task
from lfobench.data.cache import forget_imports
from lfobench.data.download import Report, discard, fetch, fetched
from lfobench.data.isolated import DataFileRefused, examine_file
from lfobench.data.readers.formats import check_first_bytes, sha256, stamp
from lfobench.data.readers.hdf5 import FileProblem
from lfobench.errors import UserError
from lfobench.files import cannot_delete, exists, write_text

FILES = "files"


class Note(BaseModel):
    """Known facts about a file.

    Attributes:
        path: of the file.
        sha256: of its bytes, when it was first used.
        stamp: size and times then, or when its hash was last found unchanged.
        address: of the download; empty for an adopted file or a user's own.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    path: str
    sha256: str
    stamp: tuple[int, int, int]
    address: str = ""


class Library(NamedTuple):
    """Index of the data files of one cache."""

    cache: Path

    def folder(self, source: str) -> Path:
        """Folder of a source's notes and downloads."""
        return self.cache / FILES / source

    def place(self, source: str, file: DataFile) -> Path:
        """Path of the file's download, or of a user's own file."""
        return Path(file.path) if _is_own(file) and file.path else self.folder(source) / f"{file.name}.hdf5"

    def note(self, source: str, file: DataFile) -> Note | None:
        """Note of a file; None where there is none.

        Raises:
            UserError: the note is unreadable, so that a changed file would go unnoticed.
        """
        path = self._note_path(source, file)
        try:
            return Note.model_validate_json(path.read_bytes())
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            why = f"cannot be read ({error.strerror})"
            raise _unreadable_note(path, why, file) from error
        except (ValueError, ValidationError) as error:
            raise _unreadable_note(path, "is damaged", file) from error

    def has_note(self, source: str, file: DataFile) -> bool:
        """True if there is a note of a file, readable or not."""
        return exists(self._note_path(source, file))

    def find(self, file: DataFile, source: str) -> DataFile:
        """The file with its path and hash; unchanged where it is not on this machine.

        A user's own file may have changed. One of a source must be the one that was first used.

        Raises:
            UserError: an own file is missing, or a source's file was replaced by another.
        """
        if _is_own(file):
            return self._own(file)
        note = self.note(source, file)
        path = Path(note.path) if note else self.place(source, file)
        if not exists(path):
            return file
        return replace(file, path=str(path), sha256=self._known(source, file, note, path).sha256)

    def here(self, source: str, file: DataFile) -> Note | None:
        """Note of a present, unchanged file; None where the file or its note is missing.

        Raises:
            UserError: as `find` does.
        """
        note = self.note(source, file)
        if note is None or not exists(Path(note.path)):
            return None
        return self._known(source, file, note, Path(note.path))

    def register(self, source: str, file: DataFile, path: Path, address: str = "") -> Note:
        """Record the path and the hash of a file.

        Raises:
            UserError: it cannot be read, or is another file than the one that was first used.
        """
        earlier = self.note(source, file)
        found, stamp = _hash(path)
        if earlier is not None and earlier.sha256 != found:
            raise _changed(file, path, earlier.sha256, found, self._note_path(source, file))
        note = Note(path=str(path), sha256=found, stamp=stamp, address=address)
        write_text(self._note_path(source, file), note.model_dump_json(indent=1) + "\n")
        return note

    def forget(self, source: str, file: DataFile) -> None:
        """Remove the note of a file, so that the next file of its name is recorded anew.

        Raises:
            UserError: the disk refuses.
        """
        path = self._note_path(source, file)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise cannot_delete(path, error) from error

    def verify(self, source: str, file: DataFile) -> Note | None:
        """Hash a file again, whatever its stamp; None where there is none.

        Raises:
            UserError: as `register` does, or a known file is missing.
        """
        note = self.note(source, file)
        path = Path(note.path) if note else self.place(source, file)
        if note and not exists(path):
            raise UserError(
                f"{file.name} is no longer at {path}.",
                "Put it back, or fetch it again: lfobench data download; with --from DIR from where it is now.",
            )
        return self.register(source, file, path, note.address if note else "") if exists(path) else None

    def _own(self, file: DataFile) -> DataFile:
        path = self.place(OWN, file)
        if not exists(path):
            what = f"The data file {path} is a link that leads nowhere" if path.is_symlink() else f"No data file {path}"
            raise UserError(f"{what}.", "Name another with --source, or in the suite's file.")
        note = self.note(OWN, file)
        if note is None or note.stamp != _stamp(path):
            found, stamp = _hash(path)
            note = Note(path=str(path), sha256=found, stamp=stamp)
            with suppress(UserError):  # the note only saves hashing the file again
                write_text(self._note_path(OWN, file), note.model_dump_json(indent=1) + "\n")
        return replace(file, sha256=note.sha256)

    def _known(self, source: str, file: DataFile, note: Note | None, path: Path) -> Note:
        if note is not None and note.stamp == _stamp(path):
            return note
        return self.register(source, file, path, note.address if note else "")

    def _note_path(self, source: str, file: DataFile) -> Path:
        if not _is_own(file):
            return self.folder(source) / f"{file.name}.json"
        # Two files of one name are two files.
        return self.folder(OWN) / f"{hashlib.sha256(str(file.path).encode()).hexdigest()[:24]}.json"


def _is_own(file: DataFile) -> bool:
    return not file.addresses


def _stamp(path: Path) -> tuple[int, int, int]:
    with _problems_as_user_errors(path):
        return stamp(path)


def _hash(path: Path) -> tuple[str, tuple[int, int, int]]:
    """SHA-256 and stamp of the same bytes."""
    with _problems_as_user_errors(path):
        for _ in range(3):
            before = stamp(path)
            found = sha256(path)
            if stamp(path) == before:
                return found, before
    raise UserError(f"The data file {path} is being written to.", "Wait until it is whole, and run the command again.")


@contextmanager
def _problems_as_user_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except FileProblem as problem:
        raise UserError(f"The data file {path} cannot be used: {problem.cause}.", problem.remedy) from problem
    except OSError as error:
        raise UserError(f"Cannot read {path}: {error.strerror}.", "Name another file.") from error


def _unreadable_note(note: Path, why: str, file: DataFile) -> UserError:
    return UserError(
        f"The note {note} {why}, so that nothing says which {file.name} was first used.",
        "Delete it to take the file as it is now.",
    )


def _changed(file: DataFile, path: Path, before: str, now: str, note: Path) -> UserError:
    return UserError(
        f"{path} is not the {file.name} that was first used here: its SHA-256 was {before[:16]}… and is {now[:16]}….",
        f"Put the old file back; or, if the new one is right, delete {note} and know that results are not comparable.",
    )


MINARI = "minari:"


@dataclass(frozen=True)
class Wanted:
    """A file of a source, and the tasks and environment that it belongs to.

    Attributes:
        source: e.g. ``d4rl``.
        file: as the suite names it.
        environment: of the first task that reads it.
        tasks: that read it.
    """

    source: str
    file: DataFile
    environment: Environment
    tasks: tuple[str, ...]


def wanted_files(tasks: Sequence[Task], sources: Sequence[str] | None = None) -> list[Wanted]:
    """Files that the tasks read from these sources, or from any, each once."""
    found: dict[tuple[str, str, str | None], Wanted] = {}
    for task in tasks:
        for source, files in task.files.items():
            if sources is not None and source not in sources:
                continue
            environment = files.environment or task.environment
            for file in (files.offline, files.expert):
                if file is not None:
                    known = found.get((source, file.name, file.path), Wanted(source, file, environment, ()))
                    names = tuple(dict.fromkeys((*known.tasks, task.name)))
                    found[source, file.name, file.path] = Wanted(source, file, known.environment, names)
    return sorted(found.values(), key=lambda wanted: wanted.source)


def download(library: Library, wanted: Wanted, report: Report) -> Note:
    """Download a file, unless it is present, inspect it, and record its hash.

    Raises:
        UserError: it cannot be fetched, or fails the inspection.
    """
    if (note := library.here(wanted.source, wanted.file)) is not None:
        return note
    first = wanted.file.addresses[0]
    if first.startswith(MINARI):
        return _with_minari(library, wanted, first.removeprefix(MINARI))
    place = library.place(wanted.source, wanted.file)
    arrived = fetch(
        wanted.file.name, wanted.file.addresses, place, _not_data, lambda path: inspect(path, wanted), report
    )
    if not arrived.address:
        inspect(place, wanted)  # put there by hand, or by another process
    return library.register(wanted.source, wanted.file, place, arrived.address)


def adopt(library: Library, wanted: Wanted, folder: Path) -> Note | None:
    """Register a file in a user's folder, in its place; None where none of its names is there.

    Raises:
        UserError: it fails the inspection.
    """
    for name in _names(wanted.file):
        path = folder / name
        if exists(path):
            inspect(path, wanted)
            return library.register(wanted.source, wanted.file, path.resolve())
    return None


def known(library: Library, wanted: Wanted) -> bool:
    """True if a file, or a part of it, is or was on this machine."""
    place = library.place(wanted.source, wanted.file)
    return library.has_note(wanted.source, wanted.file) or bool(wanted.file.addresses and fetched(place))


def forget(library: Library, wanted: Wanted) -> bool:
    """Delete a file's download, its shards and its note; returns whether there was a download.

    An adopted file, or a user's own, stays in its place.

    Raises:
        UserError: another process is fetching it, or the disk refuses.
    """
    try:
        note = library.note(wanted.source, wanted.file)
    except UserError:
        note = None  # an unreadable note: the shards of its file cannot be found, and the note is removed
    deleted = bool(wanted.file.addresses) and discard(library.place(wanted.source, wanted.file))
    if note is not None:
        forget_imports(library.cache, wanted.file.name, note.sha256)
    library.forget(wanted.source, wanted.file)
    return deleted


def inspect(path: Path, wanted: Wanted) -> None:
    """Refuse a file that cannot be trained on, or does not fit its environment.

    Raises:
        UserError: with the file and the problem.
    """
    found = examine_file(path, wanted.environment.horizon, wanted.file.keys)
    if not found.usable:
        problem = next(finding.text for finding in found.findings if finding.severity == "problem")
        raise DataFileRefused(f"The data file {path} cannot be used: {problem}", "Download it again.")
    read = found.observation if wanted.file.columns is None else min(found.observation, wanted.file.columns)
    columns = {"observations": read, "actions": found.action}
    for field, shape in wanted.environment.spaces.shapes.items():
        if (columns[field],) != shape:
            raise DataFileRefused(
                f"The data file {path} is not {wanted.file.name}: its {field} have {columns[field]} columns, those of "
                f"{wanted.environment.id} {shape[0] if shape else 0}.",
                "Download it again.",
            )


def _not_data(start: bytes) -> str:
    try:
        check_first_bytes(start)
    except FileProblem as problem:
        return problem.cause
    return ""


def _names(file: DataFile) -> list[str]:
    """Usual names of the file, below the folder that its source's own tools use."""
    names = [f"{file.name}.hdf5"]
    for address in file.addresses:
        if address.startswith(MINARI):
            names.append(address.removeprefix(MINARI))
        else:
            names.append(PurePosixPath(urlsplit(address).path).name)
    return names


def _with_minari(library: Library, wanted: Wanted, identifier: str) -> Note:
    try:
        import minari
        from minari.storage.local import get_dataset_path
    except ImportError as error:
        raise UserError(
            f"{wanted.file.name} is fetched by Minari's own tool, which is not installed.",
            "Install it: pip install 'lfobench[minari]'; or adopt a copy with --from DIR.",
        ) from error
    try:
        minari.download_dataset(identifier)
        path = Path(get_dataset_path(identifier))
    except Exception as error:  # any error of a host, a network or another library
        raise UserError(
            f"Minari cannot fetch {identifier} ({type(error).__name__}: {error}).",
            "Try again later, adopt a copy with --from DIR, or use --source generated.",
        ) from error
    inspect(path, wanted)
    return library.register(wanted.source, wanted.file, path, f"{MINARI}{identifier}")
