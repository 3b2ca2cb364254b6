"""D4RL's layout: flat arrays, one row per step, with flags where an episode ends.

``observations [N, obs]``, ``actions [N, act]``, ``terminals [N]``; ``rewards``, ``timeouts`` and ``next_observations``
may be missing. Without ``timeouts``, an episode ends when its step counter reaches the horizon, as in D4RL's own reader
(methods.md 2.1). What is both terminated and timed out is timed out, again as there. That reader ignores
``next_observations``; here they say in which observation an episode ends, and where one ends that no flag tells of.
"""

from __future__ import annotations

import h5py
import numpy as np

from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray
from lfobench.data.readers.arrays import Array, array, blocks
from lfobench.data.readers.hdf5 import OTHER, FileProblem, members
from lfobench.data.readers.reading import Reading, as_float32, flags, numbers, row_numbers, same_columns, same_rows

ESSENTIAL = ("observations", "actions", "terminals")
CONTINUES = 1e-6
"""Distance below which a next observation is the following observation (methods.md 2.2)."""


def lacking(root: h5py.File) -> list[str]:
    """Which arrays are missing without which a file is not in D4RL's layout."""
    names = members(root)
    return [name for name in ESSENTIAL if name not in names]


def read(root: h5py.File, horizon: int | None = None) -> Reading:
    """Every row of a file.

    Args:
        root: the open file.
        horizon: steps after which an episode is cut; needed where the file has no ``timeouts``.

    Raises:
        FileProblem: naming the field.
    """
    names = members(root)
    observations, actions = array(root, "observations", 2), array(root, "actions", 2)
    following = array(root, "next_observations", 2) if "next_observations" in names else None
    rewards = array(root, "rewards", 1) if "rewards" in names else None
    marks = [array(root, name, 1) for name in ("terminals", "timeouts") if name in names]
    same_rows(
        [found for found in (actions, rewards, following, *marks) if found is not None],
        observations.rows,
        "'observations'",
    )
    if not observations.rows:
        raise FileProblem("field 'observations' has no row", OTHER)
    if following is not None:
        same_columns(following, observations.shape[1], "'observations'")

    terminals, *timed = map(flags, marks)
    breaks, goes_on, not_finite = _breaks(observations, following)
    timeouts = timed[0] if timed else _cut_at_horizon(terminals | breaks, horizon)
    if not (terminals | timeouts).any():
        raise _no_end(bool(timed), horizon)
    gaps = np.flatnonzero(breaks & ~(terminals | timeouts))
    unmarked = ~(terminals | timeouts | breaks)
    unfinished = bool(unmarked[-1])
    last = np.flatnonzero(~unmarked)
    if unfinished:
        last = np.append(last, observations.rows - 1)
    lengths = np.diff(last, prepend=-1).astype(np.int64)
    episodes = Episodes(
        _stacked(observations, following, lengths, last),
        numbers(actions),
        np.full(observations.rows, np.nan, np.float32) if rewards is None else numbers(rewards),
        lengths,
        terminals[last] & ~timeouts[last],
    )
    return Reading(
        episodes,
        "d4rl",
        rewards=rewards is not None,
        timeouts=bool(timed),
        ends_known=following is not None,
        gaps=gaps,
        misplaced=np.flatnonzero(timed[0] & goes_on) if timed else np.zeros(0, np.int64),
        not_finite=np.flatnonzero(not_finite & unmarked),
        unfinished=unfinished,
        both_flags=int((terminals & timeouts).sum()),
    )


def _cut_at_horizon(ends: BoolArray, horizon: int | None) -> BoolArray:
    """Time-outs ``[N]`` where a file has none: every `horizon` steps after an episode's start, which follows an end."""
    if horizon is None:
        raise FileProblem(
            "field 'timeouts' is missing, so that nothing says which episodes time ended",
            "Give the horizon with --horizon, or use the file in a task, which knows it.",
        )
    begins = np.concatenate(([0], np.flatnonzero(ends) + 1))
    episode: IntArray = np.cumsum(ends) - ends
    step = np.arange(len(ends)) - begins[episode]
    cut: BoolArray = step % horizon == horizon - 1
    return cut


def _no_end(flagged: bool, horizon: int | None) -> FileProblem:
    if flagged:
        return FileProblem(
            "no episode ends: neither 'terminals' nor 'timeouts' marks a row", "Mark the last row of every episode."
        )
    return FileProblem(
        f"no episode ends: 'terminals' marks no row, there is no field 'timeouts', and no episode reaches the horizon "
        f"of {horizon:,} steps",
        "Mark the last row of every episode in 'timeouts', or give the horizon that it was recorded with.",
    )


def _breaks(observations: Array, following: Array | None) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Where episodes break, where they go on, and where that cannot be told.

    Returns:
        ``[N]``; True where the next observation is not that of the following row, as at the end of an episode. Values
        that are not finite, in either, say nothing about it.
        ``[N]``; True where it is, and all values are finite. The last row of a file goes nowhere.
        ``[N]``; True where a next observation has a value that is not.
    """
    breaks, goes_on, not_finite = np.zeros((3, observations.rows), np.bool_)
    if following is None:
        return breaks, goes_on, not_finite
    for start, (these, nexts) in blocks([observations, following], further=1):
        with np.errstate(invalid="ignore", over="ignore"):
            differences = nexts[:-1].astype(np.float64) - these[1:]
            comparable = np.isfinite(nexts[:-1]) & np.isfinite(these[1:])
            squares = np.square(differences, where=comparable, out=np.zeros_like(differences)).sum(axis=1)
        here = slice(start, start + len(squares))
        breaks[here] = squares > CONTINUES**2
        goes_on[here] = ~breaks[here] & comparable.all(axis=1)
        not_finite[start : start + len(nexts)] = ~np.isfinite(nexts).all(axis=1)
    return breaks, goes_on, not_finite


def _stacked(observations: Array, following: Array | None, lengths: IntArray, last: IntArray) -> FloatArray:
    """Observations of episodes ``[N + E, obs]``: those of the rows, and after a `last` one that which it leads to."""
    stacked = np.empty((observations.rows + len(lengths), observations.shape[1]), np.float32)
    place = row_numbers(lengths)
    for start, (block,) in blocks([observations]):
        stacked[place[start : start + len(block)]] = as_float32(block)
    if following is None:
        stacked[place[last] + 1] = np.nan
        return stacked
    for start, (block,) in blocks([following]):
        here = last[(last >= start) & (last < start + len(block))]
        stacked[place[here] + 1] = as_float32(block[here - start])
    return stacked
