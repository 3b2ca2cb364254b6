"""What a table cell says about its samples: how many, their mean and their spread."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lfobench.contract.statistic import mean, tie


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


def difference(first: Summary, second: Summary) -> float:
    """Mean of the first minus mean of the second; 0 where they are level."""
    between = first.mean - second.mean
    return 0.0 if abs(between) <= tie((first.mean, second.mean, first.std or 0.0, second.std or 0.0)) else between


def summarize(samples: Sequence[float], level: float | None = None) -> Summary:
    """The summary of finite samples ``[n]``, one per seed, from exact sums: their order plays no part.

    Samples no further apart than `level`, by default their own `tie`, have no spread.

    Raises:
        ValueError: there is no sample, one is not finite, or they are too far apart for floating-point numbers.
    """
    if not samples or not all(map(math.isfinite, samples)):
        raise ValueError(f"A summary needs at least one sample, all finite; got {list(samples)}.")
    centre = mean(samples)
    if len(samples) == 1:
        return Summary(1, centre, None)
    if max(samples) - min(samples) <= (tie(samples) if level is None else level):
        return Summary(len(samples), centre, 0.0)
    deviations = [sample - centre for sample in samples]
    # In units of the largest, squares neither overflow nor vanish.
    unit = max(map(abs, deviations))
    std = unit * math.sqrt(math.fsum((each / unit) ** 2 for each in deviations) / (len(samples) - 1))
    if not math.isfinite(std):
        raise ValueError(f"The samples lie too far apart to be summarized: {min(samples):g} to {max(samples):g}.")
    return Summary(len(samples), centre, std)
