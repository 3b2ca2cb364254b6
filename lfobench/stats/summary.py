"""What a table cell says about its samples: how many, their mean and their spread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Summary:
    """Mean and spread of `n` samples, in the samples' unit.

    Attributes:
        n: number of samples, at least 1.
        mean: their arithmetic mean.
        std: their sample standard deviation (ddof 1), or None for a single sample. One sample carries no
            information about spread, and a printed "± 0" would claim that it does.
    """

    n: int
    mean: float
    std: float | None


def summarize(samples: Sequence[float]) -> Summary:
    """The summary of finite samples ``[n]``, one per seed.

    Raises:
        ValueError: there is no sample, or one is not finite.
    """
    values = np.asarray(samples, dtype=np.float64)
    if values.size == 0 or not np.isfinite(values).all():
        raise ValueError(f"A summary needs at least one sample, all finite; got {list(samples)}.")
    if values.size == 1:
        return Summary(1, float(values[0]), None)
    # Rounding in the mean would give equal samples a spread of 1e-17, and a test with it.
    if values.min() == values.max():
        return Summary(values.size, float(values[0]), 0.0)
    return Summary(values.size, float(values.mean()), float(values.std(ddof=1)))
