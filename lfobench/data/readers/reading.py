"""Result of reading a file: its episodes, and the decisions that were made about them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray
from lfobench.data.readers.arrays import Array, PlainArray, array, blocks, in_proportion
from lfobench.data.readers.hdf5 import DAMAGE, OTHER, FileProblem, member, members, subgroup
from lfobench.text import counted, shown


def _no_rows() -> IntArray:
    return np.zeros(0, np.int64)


@dataclass(frozen=True)
class Reading:
    """A file's episodes, and facts about the file that they do not hold.

    Attributes:
        episodes: of the file, in its order. Where the file does not say which observation an episode ends in, that
            one is NaN. Rewards are NaN where the file has none.
        format: ``d4rl``, ``minari``, ``robomimic``, ``npz`` or ``lerobot``.
        keys: keys that make up an observation, where the file leaves a choice, and the number of columns of each.
        left_out: other keys of an observation, and their columns; 0 for one that is not a list of vectors.
        chosen: whether the user chose the keys.
        not_read: names of other members of the file.
        rewards: whether the file has any.
        rewardless: episodes without rewards in a file that has some; none is read then.
        timeouts: whether the file says which episodes time ended.
        ends_known: whether the file says which observation every episode ends in.
        gaps: ``[G]`` last rows of episodes that no flag ends and whose next observation is not the following one.
        misplaced: ``[M]`` rows that are marked as timed out and whose next observation is the following one.
        not_finite: ``[B]`` rows within an episode whose next observation, which is not kept, has a value that is no
            finite number.
        endless: ``[E']`` numbers of episodes that no mark ends, where a file has marks.
        ended_within: ``[W]`` rows that are marked as last and are not.
        both_flags: episodes that are marked as terminated and as timed out.
        kinds: fields whose numbers are of several types, and how many arrays have each.
        declared_episodes: how many the file itself says that it has; None where it does not.
        declared_steps: of all episodes, likewise.
    """

    episodes: Episodes
    format: str
    keys: Mapping[str, int] = field(default_factory=dict)
    left_out: Mapping[str, int] = field(default_factory=dict)
    chosen: bool = False
    not_read: tuple[str, ...] = ()
    rewards: bool = True
    rewardless: int = 0
    timeouts: bool = True
    ends_known: bool = True
    gaps: IntArray = field(default_factory=_no_rows)
    misplaced: IntArray = field(default_factory=_no_rows)
    not_finite: IntArray = field(default_factory=_no_rows)
    endless: IntArray = field(default_factory=_no_rows)
    ended_within: IntArray = field(default_factory=_no_rows)
    both_flags: int = 0
    kinds: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    declared_episodes: int | None = None
    declared_steps: int | None = None


def differing_kinds(fields: Mapping[str, Iterable[PlainArray]]) -> dict[str, dict[str, int]]:
    """Fields whose arrays hold numbers of several types, and how many arrays have each."""
    counts = {name: Counter(each.kind for each in arrays) for name, arrays in fields.items()}
    return {name: dict(kinds) for name, kinds in counts.items() if len(kinds) > 1}


def flags(found: PlainArray) -> BoolArray:
    """An array of flags, whole ``[N]``.

    Raises:
        FileProblem: for values other than 0 and 1.
    """
    values = found.read()
    if not ((values == 0) | (values == 1)).all():
        row = int(np.argmax((values != 0) & (values != 1)))
        raise FileProblem(f"field '{found.field}' has {values[row]!r} in row {row}, where 0 or 1 belongs", OTHER)
    return values.astype(np.bool_)


def numbers(found: PlainArray) -> FloatArray:
    """An array of numbers, whole; read in blocks, so that little more than the result is ever held."""
    whole = np.empty(found.shape, np.float32)
    for start, (block,) in blocks([found]):
        whole[start : start + len(block)] = as_float32(block)
    return whole


def end_to_end(parts: list[Array]) -> FloatArray:
    """Arrays end to end, each read straight to its place.

    Raises:
        FileProblem: together they are out of proportion to the file, which has the same array under many names.
    """
    in_proportion(parts)
    whole = np.empty((sum(part.rows for part in parts), *parts[0].shape[1:]), np.float32)
    stop = 0
    for part in parts:
        start, stop = stop, stop + part.rows
        whole[start:stop] = as_float32(part.read())
    return whole


def as_float32(values: NDArray[Any]) -> FloatArray:
    """Values as float32; one beyond its range becomes infinite, which `check` refuses."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32, copy=False)


def same_rows(arrays: Iterable[PlainArray], rows: int, measure: str) -> None:
    """Refusal of arrays of different length.

    Raises:
        FileProblem: naming the first array that has another number of rows than `measure`.
    """
    for each in arrays:
        if each.rows != rows:
            there = counted(each.rows, "row")
            raise FileProblem(f"field '{each.field}' has {there}, and {measure} has {rows:,}", OTHER)


def same_columns(found: PlainArray, columns: int, measure: str) -> None:
    """Refusal of an array with another number of columns than `measure`.

    Raises:
        FileProblem: naming both.
    """
    if found.shape[1] != columns:
        there = counted(found.shape[1], "column")
        raise FileProblem(f"field '{found.field}' has {there}, and {measure} has {columns:,}", OTHER)


def row_numbers(lengths: NDArray[np.int64]) -> IntArray:
    """Indices ``[N]`` of rows' observations among those of episodes, each of which has one observation more."""
    return np.arange(int(lengths.sum())) + np.repeat(np.arange(len(lengths)), lengths)


Keys = tuple[str, ...] | None
"""Keys that the user chose; None takes those of the layout."""


def choose(there: Sequence[str]) -> str:
    """Remedy for a missing key: the keys that the user can choose from."""
    example = "+".join(shown(name) for name in there[:2]) or "A+B"
    return f"Choose what an observation is made of: keys={example} in --source, --keys {example} of the doctor."


def no_choice(layout: str) -> FileProblem:
    """Problem of chosen keys for a file that leaves no choice."""
    return FileProblem(
        f"keys were chosen, and its observations are one array, as {layout} has them", "Leave out the keys."
    )


def arrays_of(dictionaries: Sequence[h5py.Group], keys: Sequence[str]) -> list[list[Array]]:
    """Arrays per dictionary and key, each as wide as in the first dictionary.

    Raises:
        FileProblem: naming the field, and for a missing key, those that are there.
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
    """Other members of a dictionary, with their columns; 0 for one that is not a list of vectors."""
    widths = {}
    for name in members(dictionary):
        if name in keys or any(key.startswith(f"{name}/") for key in keys):
            continue
        shape: tuple[int, ...] = ()
        with suppress(FileProblem, *DAMAGE):  # left out in any case
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


def not_finite(reading: Reading) -> dict[str, IntArray]:
    """Rows ``[B]`` per field with a value that is not a finite number.

    Unknown last observations do not count, where the file does not hold them.
    """
    episodes = reading.episodes
    ends = np.zeros(len(episodes.observations), np.bool_)
    ends[episodes.last_observation] = True
    finite = np.isfinite(episodes.observations).all(axis=1)
    reached = finite[ends]
    if not reading.ends_known:
        reached |= episodes.unknown_ends
    last = np.cumsum(episodes.lengths) - 1
    return {
        "observations": np.flatnonzero(~finite[~ends]),
        "next_observations": np.union1d(last[~reached], reading.not_finite),
        "actions": np.flatnonzero(~np.isfinite(episodes.actions).all(axis=1)),
        "rewards": np.flatnonzero(~np.isfinite(episodes.rewards) & reading.rewards),
    }


def check(reading: Reading) -> None:
    """Refusal of a file with values that are not finite.

    Raises:
        FileProblem: naming the field and the first such row.
    """
    for name, rows in not_finite(reading).items():
        if len(rows):
            raise FileProblem(
                f"field '{name}' has a value that is no finite number, the first in row {int(rows[0]):,}",
                f"{OTHER} 'lfobench data doctor' counts them.",
            )


def with_columns(episodes: Episodes, columns: int | None) -> Episodes:
    """The first `columns` of every observation; None keeps all.

    Raises:
        FileProblem: there are fewer.
    """
    if columns is None:
        return episodes
    if (there := episodes.observations.shape[1]) < columns:
        has = counted(there, "column")
        raise FileProblem(f"field 'observations' has {has}, and {columns} are to be read", OTHER)
    return replace(episodes, observations=np.ascontiguousarray(episodes.observations[:, :columns]))
