"""Data files on this machine: where each lies and what its hash was when it was first used.

Below the cache, ``files/<source>/<name>.json`` is the note of one file and, where it was downloaded, ``<name>.hdf5``
is the file itself. A file that was adopted stays where it is. The hash is recorded on first use and compared ever
after; the file is only read again for it when it looks changed.
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
    """What is known of a file.

    Attributes:
        path: where it lies.
        sha256: of its bytes, when it was first used.
        stamp: size and times then or when its hash was last found unchanged.
        address: where it was downloaded from; empty of one that was adopted, or is the user's own.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    path: str
    sha256: str
    stamp: tuple[int, int, int]
    address: str = ""


class Library(NamedTuple):
    """The files that a cache knows of."""

    cache: Path

    def folder(self, source: str) -> Path:
        """Where a source's notes and downloads lie."""
        return self.cache / FILES / source

    def place(self, source: str, file: DataFile) -> Path:
        """Where a download of the file lies, or the user's own."""
        return Path(file.path) if _is_own(file) and file.path else self.folder(source) / f"{file.name}.hdf5"

    def note(self, source: str, file: DataFile) -> Note | None:
        """What is known of a file; None where nothing is.

        Raises:
            UserError: its note says nothing, so that nobody knows whether the file is the one that was first used.
        """
        path = self._note_path(source, file)
        try:
            return Note.model_validate_json(path.read_bytes())
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            why = f"cannot be read ({error.strerror})"
            raise _no_telling(path, why, file) from error
        except (ValueError, ValidationError) as error:
            raise _no_telling(path, "is damaged", file) from error

    def has_note(self, source: str, file: DataFile) -> bool:
        """Whether there is a note of a file, readable or not."""
        return exists(self._note_path(source, file))

    def find(self, file: DataFile, source: str) -> DataFile:
        """The file with its path and hash; as it is where it is not here.

        A user's own file is taken as it is now. One of a source must be what it was when it was first used.

        Raises:
            UserError: an own file is not there, or another file has taken the place of a source's.
        """
        if _is_own(file):
            return self._own(file)
        note = self.note(source, file)
        path = Path(note.path) if note else self.place(source, file)
        if not exists(path):
            return file
        return replace(file, path=str(path), sha256=self._known(source, file, note, path).sha256)

    def here(self, source: str, file: DataFile) -> Note | None:
        """The note of a file that is here and is what it was; None where it is not here, or was never noted.

        Raises:
            UserError: as `find` does.
        """
        note = self.note(source, file)
        if note is None or not exists(Path(note.path)):
            return None
        return self._known(source, file, note, Path(note.path))

    def take_in(self, source: str, file: DataFile, path: Path, address: str = "") -> Note:
        """Note where a file lies and what its hash is.

        Raises:
            UserError: it cannot be read, or it is another file than the one that was first used.
        """
        earlier = self.note(source, file)
        found, stamp = _hash(path)
        if earlier is not None and earlier.sha256 != found:
            raise _changed(file, path, earlier.sha256, found, self._note_path(source, file))
        note = Note(path=str(path), sha256=found, stamp=stamp, address=address)
        write_text(self._note_path(source, file), note.model_dump_json(indent=1) + "\n")
        return note

    def forget(self, source: str, file: DataFile) -> None:
        """Remove the note of a file, so that the next one of its name is taken as it is.

        Raises:
            UserError: the disk refuses.
        """
        path = self._note_path(source, file)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise cannot_delete(path, error) from error

    def verify(self, source: str, file: DataFile) -> Note | None:
        """Hash a file again, however it looks; None where there is none.

        Raises:
            UserError: as `take_in` does, or the file is known and is not where it was.
        """
        note = self.note(source, file)
        path = Path(note.path) if note else self.place(source, file)
        if note and not exists(path):
            raise UserError(
                f"{file.name} is no longer at {path}.",
                "Put it back, or fetch it again: lfobench data download; with --from DIR from where it is now.",
            )
        return self.take_in(source, file, path, note.address if note else "") if exists(path) else None

    def _own(self, file: DataFile) -> DataFile:
        path = self.place(OWN, file)
        if not exists(path):
            what = f"The data file {path} is a link that leads nowhere" if path.is_symlink() else f"No data file {path}"
            raise UserError(f"{what}.", "Name another with --source, or in the suite's file.")
        note = self.note(OWN, file)
        if note is None or note.stamp != _stamp(path):
            found, stamp = _hash(path)
            note = Note(path=str(path), sha256=found, stamp=stamp)
            with suppress(UserError):  # it only saves hashing the file again
                write_text(self._note_path(OWN, file), note.model_dump_json(indent=1) + "\n")
        return replace(file, sha256=note.sha256)

    def _known(self, source: str, file: DataFile, note: Note | None, path: Path) -> Note:
        if note is not None and note.stamp == _stamp(path):
            return note
        return self.take_in(source, file, path, note.address if note else "")

    def _note_path(self, source: str, file: DataFile) -> Path:
        if not _is_own(file):
            return self.folder(source) / f"{file.name}.json"
        # Two files of one name are two files.
        return self.folder(OWN) / f"{hashlib.sha256(str(file.path).encode()).hexdigest()[:24]}.json"


def _is_own(file: DataFile) -> bool:
    return not file.addresses


def _stamp(path: Path) -> tuple[int, int, int]:
    with _refusals_named(path):
        return stamp(path)


def _hash(path: Path) -> tuple[str, tuple[int, int, int]]:
    """SHA-256 and stamp of the same bytes."""
    with _refusals_named(path):
        for _ in range(3):
            before = stamp(path)
            found = sha256(path)
            if stamp(path) == before:
                return found, before
    raise UserError(f"The data file {path} is being written to.", "Wait until it is whole, and run the command again.")


@contextmanager
def _refusals_named(path: Path) -> Iterator[None]:
    try:
        yield
    except FileProblem as problem:
        raise UserError(f"The data file {path} cannot be used: {problem.cause}.", problem.remedy) from problem
    except OSError as error:
        raise UserError(f"Cannot read {path}: {error.strerror}.", "Name another file.") from error


def _no_telling(note: Path, why: str, file: DataFile) -> UserError:
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
    """A file of a source and what it must fit.

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
    """Every file that the tasks read from these sources, or from any, each once."""
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


def bring(library: Library, wanted: Wanted, report: Report) -> Note:
    """Download a file, unless it is here, look at it, and note its hash.

    Raises:
        UserError: it cannot be had, or is not what it should be.
    """
    if (note := library.here(wanted.source, wanted.file)) is not None:
        return note
    first = wanted.file.addresses[0]
    if first.startswith(MINARI):
        return _with_minari(library, wanted, first.removeprefix(MINARI))
    place = library.place(wanted.source, wanted.file)
    arrived = fetch(wanted.file.name, wanted.file.addresses, place, _not_data, lambda path: look(path, wanted), report)
    if not arrived.address:
        look(place, wanted)  # put there by hand, or by another process
    return library.take_in(wanted.source, wanted.file, place, arrived.address)


def adopt(library: Library, wanted: Wanted, folder: Path) -> Note | None:
    """Use a file that lies in a folder of somebody's, where it lies; None where none of its names is there.

    Raises:
        UserError: what is there is not what it should be.
    """
    for name in _names(wanted.file):
        path = folder / name
        if exists(path):
            look(path, wanted)
            return library.take_in(wanted.source, wanted.file, path.resolve())
    return None


def known(library: Library, wanted: Wanted) -> bool:
    """Whether a file, or a part of it, is here or was."""
    place = library.place(wanted.source, wanted.file)
    return library.has_note(wanted.source, wanted.file) or bool(wanted.file.addresses and fetched(place))


def forget(library: Library, wanted: Wanted) -> bool:
    """Delete what was fetched of a file and what was made of it, and its note; returns whether anything was fetched.

    A file that was adopted, or is the user's own, stays where it lies.

    Raises:
        UserError: another process is fetching it, or the disk refuses.
    """
    try:
        note = library.note(wanted.source, wanted.file)
    except UserError:
        note = None  # which hides what was made of the file, and is forgotten like any other
    deleted = bool(wanted.file.addresses) and discard(library.place(wanted.source, wanted.file))
    if note is not None:
        forget_imports(library.cache, wanted.file.name, note.sha256)
    library.forget(wanted.source, wanted.file)
    return deleted


def look(path: Path, wanted: Wanted) -> None:
    """Refuse a file that cannot be trained on, or is not of its environment.

    Raises:
        UserError: naming the file and what is wrong with it.
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
    """Under which names people have it, below the folder that its source's own tools use."""
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
    except Exception as error:  # whatever a host, a network or another library raises
        raise UserError(
            f"Minari cannot fetch {identifier} ({type(error).__name__}: {error}).",
            "Try again later, adopt a copy with --from DIR, or use --source generated.",
        ) from error
    look(path, wanted)
    return library.take_in(wanted.source, wanted.file, path, f"{MINARI}{identifier}")
