"""The A/A self-test: how often a decision rule sees a winner among methods that do not differ.

References:
    P. Henderson, R. Islam, P. Bachman, J. Pineau, D. Precup, D. Meger, "Deep reinforcement learning that matters",
    AAAI 2018, section "Random seeds": runs of one algorithm, split in two, can look like two algorithms.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lfobench.stats.intervals import Estimate
from lfobench.stats.successes import wilson_interval


def false_highlight_rate(
    decide: Callable[[NDArray[np.float64]], bool],
    methods: int,
    seeds: int,
    rows: int = 2000,
    level: float = 0.95,
    seed: int = 0,
) -> Estimate:
    """Fraction of rows in which `decide` names a single winner among identical methods, with its Wilson interval.

    A row is scores ``[methods, seeds]``, independent and standard normal; `decide` says whether one method stands
    out. Row k depends on `seed`, the shape and k alone, so more rows extend fewer.

    Raises:
        ValueError: there is no method, no seed or no row, or `level` is not strictly between 0 and 1.
    """
    if min(methods, seeds, rows) < 1:
        raise ValueError(f"There must be methods, seeds and rows; got {methods}, {seeds} and {rows}.")
    random = np.random.default_rng(seed)
    found = sum(bool(decide(random.standard_normal((methods, seeds)))) for _ in range(rows))
    return Estimate(found / rows, wilson_interval(found, rows, level))
