"""The demonstration as lines that can be drawn: what follows what in the rows that methods observe."""

from __future__ import annotations

import numpy as np

from lfobench.contract.episodes import FloatArray
from lfobench.contract.method import DataNeeds
from lfobench.data.source import TaskData


def demonstrated_strokes(data: TaskData, columns: slice) -> list[FloatArray]:
    """Lines ``[T + 1, 2]`` through the observed expert transitions, raw; of sampled ones each is a line of its own.

    Args:
        data: of the task.
        columns: two of the observation's.
    """
    needs = DataNeeds(
        offline=("observation",),
        expert=("observation", "next_observation"),
        boundary="exact",
        termination="zero",
    )
    rows = data.mixture(needs).expert
    # The mixture's own observations may be standardised; its rows count through both parts, end to end.
    positions = np.concatenate([part.observations[:, columns] for part in (data.offline, data.expert)])
    breaks = np.flatnonzero(rows.next_observation[:-1] != rows.observation[1:]) + 1
    return [
        np.concatenate([positions[rows.observation[part]], positions[rows.next_observation[part[-1:]]]])
        for part in np.split(np.arange(len(rows)), breaks)
    ]
