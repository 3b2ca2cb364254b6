"""HDF5 files from anywhere, opened with suspicion: no link, soft or external, is followed out of its place."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from lfobench.text import shown

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

Remedy = Callable[[Sequence[str]], str]
"""What to do about a field that is missing, given the names that are there."""


def another(there: Sequence[str]) -> str:
    """The remedy where no other is known."""
    return OTHER


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


def subgroup(group: h5py.Group, name: str, remedy: Remedy = another) -> h5py.Group:
    """A group directly below another; `remedy` is for one that is missing.

    Raises:
        FileProblem: it is missing, a link out of its place, or no group.
    """
    found = member(group, name, remedy)
    if not isinstance(found, h5py.Group):
        raise FileProblem(f"'{path_of(group, name)}' is not a group", OTHER)
    return found


def enumerated(names: Sequence[str]) -> str:
    """The first of names from a file, harmless."""
    first = [shown(name) for name in names[:MOST_LISTED]]
    return ", ".join([*first, *(["…"] if len(names) > MOST_LISTED else [])]) or "nothing"


def missing(field: str, there: Sequence[str], remedy: Remedy = another) -> FileProblem:
    """A field that is not there, with what is, wherever it lacks."""
    return FileProblem(f"field '{shown(field, 100)}' is missing (there: {enumerated(there)})", remedy(there))


def has(group: h5py.Group, name: str) -> bool:
    """Whether anything in a group has that name, which is looked up faster than the group is listed.

    Raises:
        FileProblem: when the group is damaged.
    """
    try:
        return bool(group.id.links.exists(name.encode()))
    except DAMAGE as error:
        raise FileProblem(f"group '{shown(group.name or '')}' cannot be listed ({short(error)})", AGAIN) from error


def is_group(group: h5py.Group, name: str) -> bool:
    """Whether there is a group of that name.

    Raises:
        FileProblem: nothing has that name, or a link out of its place.
    """
    return isinstance(member(group, name), h5py.Group)


def member(group: h5py.Group, name: str, remedy: Remedy = another) -> object:
    """An object that lies in the group itself; its name is looked up as one link before it is opened.

    Args:
        group: that it lies in.
        name: in the group.
        remedy: where there is none.

    Raises:
        FileProblem: nothing has that name, or a link out of its place, or it is damaged.
    """
    try:
        # What get_info raises over a name that is not there differs between versions and formats of groups.
        if not group.id.links.exists(name.encode()):
            raise missing(path_of(group, name), members(group), remedy)
        if group.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
            raise FileProblem(f"'{path_of(group, name)}' is a link to elsewhere, which is never followed", OTHER)
        # As group[name], at a third of its time, which counts where a file has 100,000 members.
        found = h5py.h5o.open(group.id, name.encode())
    except DAMAGE as error:
        raise FileProblem(f"'{path_of(group, name)}' cannot be opened ({short(error)})", AGAIN) from error
    if isinstance(found, h5py.h5g.GroupID):
        return h5py.Group(found)
    return h5py.Dataset(found) if isinstance(found, h5py.h5d.DatasetID) else found


def numbered(group: h5py.Group, pattern: re.Pattern[str]) -> list[str]:
    """Names in a group that match a pattern, by the number in them, which may be padded with zeros.

    Raises:
        FileProblem: two names have one number.
    """
    found: dict[int, str] = {}
    for name in members(group):
        if matched := pattern.fullmatch(name):
            if (number := int(matched[1])) in found:
                raise FileProblem(f"'{found[number]}' and '{name}' are both number {number:,}", OTHER)
            found[number] = name
    return [found[number] for number in sorted(found)]


def count_said(group: h5py.Group, name: str) -> int | None:
    """A count that a group's attribute gives; None where there is none, or what there is is no whole number."""
    try:
        if not h5py.h5a.exists(group.id, name.encode()):
            return None
        attribute = h5py.h5a.open(group.id, name.encode())
        if attribute.shape != () or attribute.dtype.kind not in "iu":
            return None
        value = np.empty((), attribute.dtype)
        attribute.read(value)
    except DAMAGE:
        return None
    return int(value)


def path_of(group: h5py.Group, name: str) -> str:
    """Where a member of a group lies in the file."""
    return f"{(group.name or '').strip('/')}/{name}".strip("/")


def short(error: BaseException) -> str:
    """An error of HDF5 in one short line."""
    return shown(str(error), 120)
