"""Moments and standardising, block by block, against NumPy's over everything at once."""

from __future__ import annotations

import numpy as np
import pytest

from lfobench.contract.episodes import FloatArray
from lfobench.data import mixing as standard
from lfobench.data.mixing import BLOCK, moments, standardize

COUNTS = [1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5]


def observations(count: int) -> FloatArray:
    """Columns of unlike sizes, one of them constant."""
    drawn = np.random.default_rng(count).standard_normal((count, 5)) * [1e-3, 1.0, 50.0, 1e4, 0.0] + [0, 3, -70, 1e5, 2]
    return drawn.astype(np.float32)


@pytest.mark.parametrize("count", COUNTS)
def test_moments_are_those_of_the_rows(count: int) -> None:
    data = observations(count)
    row = np.random.default_rng(1).integers(0, count, count)
    mean, std = moments(data, row)
    np.testing.assert_array_equal(mean.astype(np.float32), data[row].mean(0, dtype=np.float64).astype(np.float32))
    np.testing.assert_array_equal(std.astype(np.float32), data[row].std(0, dtype=np.float64).astype(np.float32))


def test_the_blocks_cannot_be_told_from_the_moments(monkeypatch: pytest.MonkeyPatch) -> None:
    data, row = observations(1_000), np.arange(1_000)
    whole = moments(data, row)
    monkeypatch.setattr(standard, "BLOCK", 7)
    for one, other in zip(moments(data, row), whole, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("count", COUNTS)
def test_standardising_in_place(count: int) -> None:
    data = observations(count)
    shift, scale = data.mean(0), data.std(0) + np.float32(1e-3)
    expected = (data - shift) / scale
    standardize(data, shift, scale)
    np.testing.assert_array_equal(data, expected)
