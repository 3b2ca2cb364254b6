"""What a reader makes of a file: episodes, and what it had to decide about them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray
from lfobench.data.readers.arrays import Array, PlainArray, blocks, in_proportion
from lfobench.data.readers.hdf5 import OTHER, FileProblem
from lfobench.words import counted


def _no_rows() -> IntArray:
    return np.zeros(0, np.int64)


@dataclass(frozen=True)
class Reading:
    """A file's episodes and what is not in them.

    Attributes:
        episodes: of the file, in its order. Where the file does not say which observation an episode ends in, that
            one is NaN. Rewards are NaN where the file has none.
        format: ``d4rl``, ``minari``, ``robomimic``, ``npz`` or ``lerobot``.
        keys: what an observation is made of, where the file leaves a choice, and how many columns each has.
        left_out: what else the file has of an observation, and how many columns; 0 of what is no list of vectors.
        chosen: whether the user chose the keys.
        not_read: what else the file has.
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
    """Values as float32; one beyond its range becomes infinite, which `checks` tells of."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32, copy=False)


def same_rows(arrays: Iterable[PlainArray], rows: int, measure: str) -> None:
    """Refuses arrays of different length.

    Raises:
        FileProblem: naming the first array that has another number of rows than `measure`.
    """
    for each in arrays:
        if each.rows != rows:
            there = counted(each.rows, "row")
            raise FileProblem(f"field '{each.field}' has {there}, and {measure} has {rows:,}", OTHER)


def same_columns(found: PlainArray, columns: int, measure: str) -> None:
    """Refuses an array of other columns than `measure` has.

    Raises:
        FileProblem: naming both.
    """
    if found.shape[1] != columns:
        there = counted(found.shape[1], "column")
        raise FileProblem(f"field '{found.field}' has {there}, and {measure} has {columns:,}", OTHER)


def row_numbers(lengths: NDArray[np.int64]) -> IntArray:
    """Where the observations of rows laid end to end lie among those of episodes, which have one more each ``[N]``."""
    return np.arange(int(lengths.sum())) + np.repeat(np.arange(len(lengths)), lengths)
