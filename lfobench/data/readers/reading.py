"""What a reader makes of a file: episodes, and what it had to decide about them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray
from lfobench.data.readers.arrays import Array, blocks, in_proportion
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
        format: ``d4rl``, ``minari`` or ``robomimic``.
        columns: what an observation is made of, where the file leaves a choice.
        rewards: whether the file has any.
        timeouts: whether the file says which episodes time ended.
        ends_known: whether the file says which observation every episode ends in.
        gaps: ``[G]`` last rows of episodes that no flag ends and whose next observation is not the following one.
        misplaced: ``[M]`` rows that are marked as timed out and whose next observation is the following one.
        not_finite: ``[B]`` rows within an episode whose next observation, which is not kept, has a value that is no
            finite number.
        unfinished: whether the file ends within an episode.
        both_flags: episodes that are marked as terminated and as timed out.
    """

    episodes: Episodes
    format: str
    columns: tuple[str, ...] = ()
    rewards: bool = True
    timeouts: bool = True
    ends_known: bool = True
    gaps: IntArray = field(default_factory=_no_rows)
    misplaced: IntArray = field(default_factory=_no_rows)
    not_finite: IntArray = field(default_factory=_no_rows)
    unfinished: bool = False
    both_flags: int = 0


def flags(found: Array) -> BoolArray:
    """An array of flags, whole ``[N]``.

    Raises:
        FileProblem: for values other than 0 and 1.
    """
    values = found.read()
    if not ((values == 0) | (values == 1)).all():
        row = int(np.argmax((values != 0) & (values != 1)))
        raise FileProblem(f"field '{found.field}' has {values[row]!r} in row {row}, where 0 or 1 belongs", OTHER)
    return values.astype(np.bool_)


def numbers(found: Array) -> FloatArray:
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


def same_rows(arrays: list[Array], rows: int, measure: str) -> None:
    """Refuses arrays of different length.

    Raises:
        FileProblem: naming the first array that has another number of rows than `measure`.
    """
    for each in arrays:
        if each.rows != rows:
            there = counted(each.rows, "row")
            raise FileProblem(f"field '{each.field}' has {there}, and {measure} has {rows:,}", OTHER)


def same_columns(found: Array, columns: int, measure: str) -> None:
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
