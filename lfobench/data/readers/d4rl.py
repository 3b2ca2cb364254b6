"""D4RL's layout: flat arrays, one row per step, with flags where an episode ends.

``observations [N, obs]``, ``actions [N, act]``, ``terminals [N]``; ``rewards``, ``timeouts`` and ``next_observations``
may be missing. Without ``timeouts``, an episode ends when its step counter reaches the horizon, as in D4RL's own
reader. What is both terminated and timed out is timed out, again as there. That reader ignores
``next_observations``; here they give the observation that an episode ends in, and reveal ends without a flag.
"""

from __future__ import annotations

from collections.abc import Mapping

import h5py
import numpy as np

from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray
from lfobench.data.readers.arrays import PlainArray, array, blocks
from lfobench.data.readers.hdf5 import OTHER, FileProblem, members
from lfobench.data.readers.reading import (
    Reading,
    as_float32,
    differing_kinds,
    flags,
    numbers,
    row_numbers,
    same_columns,
    same_rows,
)

DIMENSIONS = {
    "observations": 2,
    "actions": 2,
    "terminals": 1,
    "timeouts": 1,
    "rewards": 1,
    "next_observations": 2,
}
ESSENTIAL = ("observations", "actions", "terminals")
CONTINUES = 1e-6
"""Distance below which a next observation is the following observation."""


def lacking(root: h5py.File) -> list[str]:
    """Essential arrays of D4RL's layout that the file lacks."""
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
    found = {name: array(root, name, dimensions) for name, dimensions in DIMENSIONS.items() if name in names}
    return flat(found, "d4rl", horizon, not_read=tuple(name for name in names if name not in DIMENSIONS))


def flat(
    fields: Mapping[str, PlainArray],
    layout: str,
    horizon: int | None,
    ends: BoolArray | None = None,
    not_read: tuple[str, ...] = (),
) -> Reading:
    """Episodes from flat arrays, in a file or in memory.

    Args:
        fields: by their names in this layout; observations and actions are there, and terminals or `ends`.
        layout: name of the layout in the reading.
        horizon: as for `read`.
        ends: ``[N]``; True where an episode ends by the structure of its files, whatever flags say.
        not_read: names of other members.

    Raises:
        FileProblem: naming the field.
    """
    observations, actions = fields["observations"], fields["actions"]
    following, rewards = fields.get("next_observations"), fields.get("rewards")
    same_rows(fields.values(), observations.rows, f"'{observations.field}'")
    if not observations.rows:
        raise FileProblem(f"field '{observations.field}' has no row", OTHER)
    if following is not None:
        same_columns(following, observations.shape[1], f"'{observations.field}'")

    never = np.zeros(observations.rows, np.bool_)
    terminals = flags(fields["terminals"]) if "terminals" in fields else never
    timed = flags(fields["timeouts"]) if "timeouts" in fields else None
    breaks, goes_on, not_finite = _breaks(observations, following)
    timeouts = timed
    if timeouts is None:
        timeouts = never if ends is not None else _cut_at_horizon(terminals | breaks, horizon)
    marked = terminals | timeouts | (never if ends is None else ends)
    if not marked.any():
        raise _no_end(timed is not None, horizon)
    gaps = np.flatnonzero(breaks & ~marked)
    unmarked = ~(marked | breaks)
    last = np.flatnonzero(~unmarked)
    if unmarked[-1]:
        last = np.append(last, observations.rows - 1)
    # Without time-outs, nothing is missing where an archive ends without a flag.
    unflagged = ~breaks if ends is None else ends & (timed is not None)
    endless = (unflagged & ~(terminals | timeouts))[last]
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
        layout,
        not_read=not_read,
        rewards=rewards is not None,
        timeouts=timed is not None,
        ends_known=following is not None,
        gaps=gaps,
        misplaced=np.flatnonzero(never if timed is None else timed & goes_on),
        not_finite=np.flatnonzero(not_finite & unmarked),
        endless=np.flatnonzero(endless),
        both_flags=int((terminals & timeouts).sum()),
        kinds=differing_kinds({"observations": [observations, *([] if following is None else [following])]}),
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


def _breaks(observations: PlainArray, following: PlainArray | None) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Rows at which episodes break or continue, and rows whose next observation is not finite.

    Returns:
        ``[N]``; True where the next observation differs from that of the following row, as at the end of an episode.
        Values that are not finite, in either, are not compared.
        ``[N]``; True where the two agree, and all values are finite. The last row of a file has no following row.
        ``[N]``; True where a next observation has a value that is not finite.
    """
    breaks, goes_on, not_finite = np.zeros((3, observations.rows), np.bool_)
    if following is None:
        return breaks, goes_on, not_finite
    # Next observations that are kept with fewer digits continue an episode where they agree in those.
    kinds = [np.dtype(each.kind) for each in (observations, following)]
    coarser = min(kinds, key=lambda kind: kind.itemsize) if all(kind.kind == "f" for kind in kinds) else None
    for start, (these, nexts) in blocks([observations, following], further=1):
        with np.errstate(invalid="ignore", over="ignore"):
            if coarser is not None and kinds[0] != kinds[1]:
                these, nexts = these.astype(coarser), nexts.astype(coarser)
            differences = nexts[:-1].astype(np.float64) - these[1:]
            comparable = np.isfinite(nexts[:-1]) & np.isfinite(these[1:])
            squares = np.square(differences, where=comparable, out=np.zeros_like(differences)).sum(axis=1)
        here = slice(start, start + len(squares))
        breaks[here] = squares > CONTINUES**2
        goes_on[here] = ~breaks[here] & comparable.all(axis=1)
        not_finite[start : start + len(nexts)] = ~np.isfinite(nexts).all(axis=1)
    return breaks, goes_on, not_finite


def _stacked(observations: PlainArray, following: PlainArray | None, lengths: IntArray, last: IntArray) -> FloatArray:
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
