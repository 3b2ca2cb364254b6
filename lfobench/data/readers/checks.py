"""What training cannot do without: finite observations and actions, and the columns that are to be read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lfobench.contract.episodes import Episodes, IntArray
from lfobench.data.readers.hdf5 import OTHER, FileProblem
from lfobench.data.readers.reading import Reading
from lfobench.words import counted


def not_finite(reading: Reading) -> dict[str, IntArray]:
    """Rows ``[B]`` of every field that have a value that is no finite number.

    Those that mark a last observation as unknown are none, where the file does not say in which an episode ends.
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
    """Refuses a file with values that are not finite.

    Raises:
        FileProblem: naming the field and the first such row.
    """
    for field, rows in not_finite(reading).items():
        if len(rows):
            raise FileProblem(
                f"field '{field}' has a value that is no finite number, the first in row {int(rows[0]):,}",
                f"{OTHER} 'lfobench data doctor' tells how many there are.",
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
