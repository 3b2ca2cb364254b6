"""p-values corrected for how many were looked at.

References:
    S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979.
    Y. Benjamini, Y. Hochberg, "Controlling the false discovery rate", Journal of the Royal Statistical Society B 57,
    1995.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lfobench.stats.names import Correction


def adjusted(p_values: Sequence[float], correction: Correction) -> list[float]:
    """Adjusted p-values ``[m]``, in the order given; rejecting those below alpha is the procedure at level alpha."""
    p = np.asarray(p_values, dtype=np.float64)
    if correction == "none" or p.size == 0:
        return [float(value) for value in p]
    order = np.argsort(p, kind="stable")
    ranks = np.arange(1, p.size + 1)
    if correction == "holm":
        stepped = np.maximum.accumulate(p[order] * (p.size - ranks + 1))
    else:
        stepped = np.minimum.accumulate((p[order] * p.size / ranks)[::-1])[::-1]
    result = np.empty_like(p)
    result[order] = np.minimum(stepped, 1.0)
    return [float(value) for value in result]
