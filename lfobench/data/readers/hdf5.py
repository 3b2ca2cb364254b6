"""Untrusted HDF5 files: no soft or external link is followed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from lfobench.text import shown

METADATA_BYTES = 2**22
"""Cache limit for the file's structure; with HDF5's own limit, a file of many episodes takes 10 times as much memory as
its data."""
MOST_LISTED = 12


class FileProblem(Exception):
    """Problem that makes a file unusable, with cause and remedy.

    Attributes:
        cause: a clause that follows the file's name, e.g. ``field 'rewards' has 9 rows, …``.
        remedy: a sentence.
    """

    def __init__(self, cause: str, remedy: str) -> None:
        super().__init__(cause)
        self.cause, self.remedy = cause, remedy


DAMAGE = (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError, AttributeError, SystemError)
"""Errors of h5py over damaged bytes; a UnicodeError is a ValueError."""

AGAIN = "Copy or download it again."
OTHER = "Name another file, or fix this one."

Remedy = Callable[[Sequence[str]], str]
"""Remedy for a missing field, given the names that are there."""


def another(there: Sequence[str]) -> str:
    """Default remedy."""
    return OTHER


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading.

    Raises:
        FileProblem: HDF5 rejects it, or it is cut short.
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
    """Group directly below another; `remedy` is that of a missing one.

    Raises:
        FileProblem: it is missing, a link, or no group.
    """
    found = member(group, name, remedy)
    if not isinstance(found, h5py.Group):
        raise FileProblem(f"'{path_of(group, name)}' is not a group", OTHER)
    return found


def enumerated(names: Sequence[str]) -> str:
    """The first names of a list, escaped."""
    first = [shown(name) for name in names[:MOST_LISTED]]
    return ", ".join([*first, *(["…"] if len(names) > MOST_LISTED else [])]) or "nothing"


def missing(field: str, there: Sequence[str], remedy: Remedy = another) -> FileProblem:
    """Problem of a missing field, with the names that are there."""
    return FileProblem(f"field '{shown(field, 100)}' is missing (there: {enumerated(there)})", remedy(there))


def has(group: h5py.Group, name: str) -> bool:
    """True if a group has a member of that name; faster than listing the group.

    Raises:
        FileProblem: when the group is damaged.
    """
    try:
        return bool(group.id.links.exists(name.encode()))
    except DAMAGE as error:
        raise FileProblem(f"group '{shown(group.name or '')}' cannot be listed ({short(error)})", AGAIN) from error


def is_group(group: h5py.Group, name: str) -> bool:
    """True if the member of that name is a group.

    Raises:
        FileProblem: there is no such member, or it is a link.
    """
    return isinstance(member(group, name), h5py.Group)


def member(group: h5py.Group, name: str, remedy: Remedy = another) -> object:
    """Member of a group, which must be a hard link.

    Args:
        group: its parent.
        name: in the group.
        remedy: for a missing member.

    Raises:
        FileProblem: there is no such member, it is a link, or it is damaged.
    """
    try:
        # The error of get_info for a missing name differs between versions and formats of groups.
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


def declared_count(group: h5py.Group, name: str) -> int | None:
    """Count in a group's attribute; None where there is none, or it is not a whole number."""
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
    """Path of a group's member in the file."""
    return f"{(group.name or '').strip('/')}/{name}".strip("/")


def short(error: BaseException) -> str:
    """An error of HDF5 in one short line."""
    return shown(str(error), 120)
