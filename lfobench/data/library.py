"""Data files on this machine: where each lies and what its hash was when it was first used.

Below the cache, ``files/<source>/<name>.json`` is the note of one file and, where it was downloaded, ``<name>.hdf5``
is the file itself. A file that was adopted stays where it is. The hash is recorded on first use and compared ever
after; the file is only read again for it when it looks changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, ValidationError

from lfobench.contract.files import DataFile
from lfobench.data.readers.formats import sha256, stamp
from lfobench.data.readers.hdf5 import FileProblem
from lfobench.errors import UserError
from lfobench.files import cannot_delete, exists, write_text
from lfobench.plan.sources import OWN

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
