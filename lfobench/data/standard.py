"""Mean and standard deviation of observations, and standardising them in place, a block of rows at a time.

A block stays in the processor's cache; temporaries as long as the data take longer to allocate than to compute.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import FloatArray, IntArray

BLOCK = 2048

Float64Array = NDArray[np.float64]


def moments(observations: FloatArray, row: IntArray) -> tuple[Float64Array, Float64Array]:
    """Mean and standard deviation ``[obs]`` of the observations at `row` ``[R]``, accumulated in float64.

    Rows are added one after another, as NumPy's own reduction over the first axis adds them, so the numbers do not
    depend on `BLOCK`.
    """
    mean = _total(observations, row, lambda block: None) / np.float64(len(row))
    # One long row, because broadcasting a short one costs NumPy more than the arithmetic.
    means = np.tile(mean, BLOCK)

    def square_deviations(block: Float64Array) -> None:
        flat = block.reshape(-1)
        flat -= means[: len(flat)]
        np.multiply(flat, flat, out=flat)

    return mean, np.sqrt(_total(observations, row, square_deviations) / np.float64(len(row)))


def _total(observations: FloatArray, row: IntArray, change: Callable[[Float64Array], None]) -> Float64Array:
    """Sum ``[obs]`` over the rows of what `change` makes of every block."""
    size = observations.shape[1]
    taken, summands = np.empty((BLOCK, size), np.float32), np.empty((BLOCK + 1, size))
    total = np.zeros(size)
    for start in range(0, len(row), BLOCK):
        here = row[start : start + BLOCK]
        block = summands[1 : len(here) + 1]
        # Any other mode than "clip" fills `out` by way of another array.
        block[:] = observations.take(here, axis=0, out=taken[: len(here)], mode="clip")
        change(block)
        summands[0] = total
        # Adds row by row as sum(0) does, at a quarter of its cost.
        total = np.einsum("ij->j", summands[: len(here) + 1])
    return total


def standardize(observations: FloatArray, shift: FloatArray, scale: FloatArray) -> None:
    """Subtract and divide the contiguous ``[M, obs]`` in place."""
    shifts, scales = np.tile(shift, BLOCK), np.tile(scale, BLOCK)
    for start in range(0, len(observations), BLOCK):
        flat = observations[start : start + BLOCK].reshape(-1)
        flat -= shifts[: len(flat)]
        flat /= scales[: len(flat)]
