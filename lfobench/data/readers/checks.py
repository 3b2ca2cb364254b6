"""What training cannot do without: finite observations and actions, and the columns that are to be read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lfobench.contract.episodes import BoolArray, Episodes, IntArray
from lfobench.data.readers.hdf5 import OTHER, FileProblem
from lfobench.data.readers.reading import Reading
from lfobench.words import counted


def check(reading: Reading) -> None:
    """Refuses a file with values that are not finite, but for those that mark an unknown last observation.

    Raises:
        FileProblem: naming the field and the first such row.
    """
    episodes = reading.episodes
    ends = np.zeros(len(episodes.observations), np.bool_)
    ends[episodes.last_observation] = True
    unknown = np.zeros(len(episodes.lengths), np.bool_) if reading.ends_known else episodes.unknown_ends
    finite = np.isfinite(episodes.observations).all(axis=1)
    _check("observations", finite[~ends])
    _check("next_observations", finite[ends][~unknown], np.cumsum(episodes.lengths)[~unknown] - 1)
    within = np.ones(episodes.transitions, np.bool_)
    within[reading.not_finite] = False
    _check("next_observations", within)
    _check("actions", np.isfinite(episodes.actions).all(axis=1))
    if reading.rewards:
        _check("rewards", np.isfinite(episodes.rewards))


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


def _check(field: str, finite: BoolArray, rows: IntArray | None = None) -> None:
    if finite.all():
        return
    first = int(np.argmin(finite))
    row = first if rows is None else int(rows[first])
    raise FileProblem(
        f"field '{field}' has a value that is no finite number, the first in row {row:,}",
        f"{OTHER} 'lfobench data doctor' tells how many there are.",
    )
