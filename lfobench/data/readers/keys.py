"""The keys of an observation, where a file has a dictionary of them: which are read side by side, which are left out.

A layout has keys that are read unless the user chooses others. A key may lead into groups: ``achieved_goal/kettle``.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import h5py
import numpy as np

from lfobench.contract.episodes import FloatArray
from lfobench.data.readers.arrays import Array, array
from lfobench.data.readers.hdf5 import DAMAGE, FileProblem, member, members, subgroup
from lfobench.data.readers.reading import end_to_end, same_columns
from lfobench.words import shown

Keys = tuple[str, ...] | None
"""Keys that the user chose; None takes those of the layout."""


def choose(there: Sequence[str]) -> str:
    """The remedy where a key is missing: keys are the user's choice among what is there."""
    example = "+".join(shown(name) for name in there[:2]) or "A+B"
    return f"Choose what an observation is made of: keys={example} in --source, --keys {example} of the doctor."


def no_choice(layout: str) -> FileProblem:
    """Keys were chosen of a file that leaves no choice."""
    return FileProblem(
        f"keys were chosen, and its observations are one array, as {layout} has them", "Leave out the keys."
    )


def arrays_of(dictionaries: Sequence[h5py.Group], keys: Sequence[str]) -> list[list[Array]]:
    """Of every dictionary, the array of every key, each as wide as in the first.

    Raises:
        FileProblem: naming the field, and for a key that is missing, what is there.
    """
    found = []
    for dictionary in dictionaries:
        arrays = []
        for key in keys:
            *groups, name = key.split("/")
            group = dictionary
            for each in groups:
                group = subgroup(group, each, choose)
            arrays.append(array(group, name, 2, choose))
        found.append(arrays)
        for first, each_array in zip(found[0], arrays, strict=True):
            same_columns(each_array, first.shape[1], f"'{first.field}'")
    return found


def left_out(dictionary: h5py.Group, keys: Sequence[str]) -> dict[str, int]:
    """What else a dictionary has, and how many columns; 0 of what is no list of vectors."""
    widths = {}
    for name in members(dictionary):
        if name in keys or any(key.startswith(f"{name}/") for key in keys):
            continue
        shape: tuple[int, ...] = ()
        with suppress(FileProblem, *DAMAGE):  # it is left out, whatever it is
            found = member(dictionary, name)
            shape = (found.shape or ()) if isinstance(found, h5py.Dataset) else ()
        widths[name] = int(shape[1]) if len(shape) == 2 else 0
    return widths


def by_key(parts: Sequence[Sequence[Array]], keys: Sequence[str]) -> dict[str, list[Array]]:
    """The arrays of every key."""
    return {key: [arrays[index] for arrays in parts] for index, key in enumerate(keys)}


def widths_of(arrays: Sequence[Array], keys: Sequence[str]) -> dict[str, int]:
    """Columns of every key."""
    return {key: found.shape[1] for key, found in zip(keys, arrays, strict=True)}


def side_by_side(parts: Sequence[Sequence[Array]]) -> FloatArray:
    """Arrays of keys, episode by episode, as observations ``[rows, obs]``.

    Raises:
        FileProblem: as `end_to_end` does.
    """
    if len(parts[0]) == 1:
        return end_to_end([only for (only,) in parts])
    widths = [first.shape[1] for first in parts[0]]
    whole = np.empty((sum(arrays[0].rows for arrays in parts), sum(widths)), np.float32)
    stop = 0
    for key, width in enumerate(widths):
        start, stop = stop, stop + width
        whole[:, start:stop] = end_to_end([arrays[key] for arrays in parts])
    return whole
