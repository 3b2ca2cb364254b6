"""A suite's files: which there are, and bringing them here by download or by adoption."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

from lfobench.contract.environment import Environment
from lfobench.contract.files import DataFile
from lfobench.contract.suite import Task
from lfobench.data.cache import forget_imports
from lfobench.data.download import Report, discard, fetch, fetched
from lfobench.data.isolated import DataFileRefused, examine_file
from lfobench.data.library import Library, Note
from lfobench.data.readers.hdf5 import FileProblem
from lfobench.data.readers.start import check_first_bytes
from lfobench.errors import UserError
from lfobench.files import exists

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
