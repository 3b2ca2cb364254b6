"""Data on the host: rows chosen and gathered by NumPy, every field copied to the device on its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Array = NDArray[np.float32]
Columns = Mapping[str, Array]
Batch = dict[str, Tensor]


@dataclass(frozen=True)
class HostData:
    """A task's data as arrays of equally many rows per part.

    Attributes:
        offline: ``observation``, ``next_observation``, ``second_next_observation`` ``[N, obs]``, ``action``
            ``[N, act]``, ``reward``, ``terminated`` ``[N]``.
        initial: ``initial_observation`` ``[K, obs]``.
        expert: as `offline`.
    """

    offline: Columns
    initial: Columns
    expert: Columns


class HostBuffer:
    """Uniform draws with replacement (methods.md 2.7).

    Args:
        columns: per field ``[N, ...]``.
        fields: those that a batch holds.
        device: where batches go.
        generator: draws the rows; buffers may share it.
    """

    def __init__(
        self, columns: Columns, fields: Sequence[str], device: torch.device, generator: np.random.Generator
    ) -> None:
        self._columns = {field: columns[field] for field in fields}
        self._rows = len(columns[fields[0]])
        self._device = device
        self._generator = generator

    def sample(self, count: int) -> Batch:
        """`count` rows of every field, ``[B, ...]`` on the device."""
        row = self._generator.integers(0, self._rows, count)
        return {field: torch.from_numpy(column[row]).to(self._device) for field, column in self._columns.items()}
