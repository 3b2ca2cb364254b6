"""HDF5 files from anywhere, opened with suspicion: no link, soft or external, is followed out of its place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from lfobench.words import shown

METADATA_BYTES = 2**22
"""Of the file's structure that HDF5 keeps at most, as stored; its own limit lets a file of many episodes take 10 times
as much memory as its data."""
MOST_LISTED = 12


class FileProblem(Exception):
    """Why a file cannot be used: what is wrong with it, or with which of its fields, and what to do.

    Attributes:
        cause: a clause that follows the file's name, e.g. ``field 'rewards' has 9 rows, …``.
        remedy: a sentence.
    """

    def __init__(self, cause: str, remedy: str) -> None:
        super().__init__(cause)
        self.cause, self.remedy = cause, remedy


DAMAGE = (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError, AttributeError, SystemError)
"""What h5py raises over damaged bytes; a UnicodeError is a ValueError."""

AGAIN = "Copy or download it again."
OTHER = "Name another file, or mend this one."


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading.

    Raises:
        FileProblem: HDF5 cannot make anything of it, or it is cut short.
    """
    try:
        # Every chunk is read once, in whole blocks, so there is none to keep.
        file = h5py.File(path, "r", rdcc_nbytes=0, rdcc_nslots=1)
        kept = file.id.get_mdc_config()
        kept.max_size = METADATA_BYTES
        file.id.set_mdc_config(kept)
    except DAMAGE as error:
        if "truncated" in str(error):
            raise FileProblem("it is cut short: it ends before its own header says", AGAIN) from error
        raise FileProblem(f"HDF5 rejects it ({short(error)})", AGAIN) from error
    with file:
        yield file


def members(group: h5py.Group) -> list[str]:
    """Names in a group, in the file's order.

    Raises:
        FileProblem: when the group is damaged.
    """
    try:
        return [str(name) for name in group]
    except DAMAGE as error:
        raise FileProblem(f"group '{shown(group.name or '')}' cannot be listed ({short(error)})", AGAIN) from error


def subgroup(group: h5py.Group, name: str) -> h5py.Group:
    """A group directly below another.

    Raises:
        FileProblem: it is missing, a link out of its place, or no group.
    """
    found = member(group, name)
    if not isinstance(found, h5py.Group):
        raise FileProblem(f"'{path_of(group, name)}' is not a group", OTHER)
    return found


def listed(group: h5py.Group) -> str:
    """The first names in a group, for a message.

    Raises:
        FileProblem: when the group is damaged.
    """
    names = [shown(name) for name in members(group)[: MOST_LISTED + 1]]
    return ", ".join([*names[:MOST_LISTED], *(["…"] if len(names) > MOST_LISTED else [])]) or "nothing"


def is_group(group: h5py.Group, name: str) -> bool:
    """Whether there is a group of that name.

    Raises:
        FileProblem: nothing has that name, or a link out of its place.
    """
    return isinstance(member(group, name), h5py.Group)


def member(group: h5py.Group, name: str) -> object:
    """An object that lies in the group itself; its name is looked up as one link before it is opened.

    Raises:
        FileProblem: nothing has that name, or a link out of its place, or it is damaged.
    """
    try:
        try:
            link = group.id.links.get_info(name.encode()).type
        except KeyError:
            if name in members(group):
                raise
            raise FileProblem(f"field '{path_of(group, name)}' is missing (there: {listed(group)})", OTHER) from None
        if link != h5py.h5l.TYPE_HARD:
            raise FileProblem(f"'{path_of(group, name)}' is a link to elsewhere, which is never followed", OTHER)
        # As group[name], at a third of its time, which counts where a file has 100,000 members.
        found = h5py.h5o.open(group.id, name.encode())
    except DAMAGE as error:
        raise FileProblem(f"'{path_of(group, name)}' cannot be opened ({short(error)})", AGAIN) from error
    if isinstance(found, h5py.h5g.GroupID):
        return h5py.Group(found)
    return h5py.Dataset(found) if isinstance(found, h5py.h5d.DatasetID) else found


def path_of(group: h5py.Group, name: str) -> str:
    """Where a member of a group lies in the file."""
    return f"{(group.name or '').strip('/')}/{name}".strip("/")


def short(error: BaseException) -> str:
    """An error of HDF5 in one short line."""
    return shown(str(error), 120)
