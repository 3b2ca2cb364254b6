"""How an episode can end, in the words that every table and picture uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.int8]

NAMES = (
    None,
    "success",
    "cup hit",
    "emergency stop",
    "missed",
    "touched only",
    "stalled",
    "out of time",
)
"""Code to name; 0 goes on."""

SUCCESS, CUP_HIT, EMERGENCY_STOP, MISSED, TOUCHED_ONLY, STALLED, OUT_OF_TIME = range(1, len(NAMES))

_NAMES = np.array(NAMES, dtype=object)


def named(codes: Codes) -> NDArray[np.object_]:
    """Names ``[n]``, None where an episode goes on."""
    return _NAMES[codes]
