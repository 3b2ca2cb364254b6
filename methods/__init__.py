"""Methods that ship with lfobench, one a file; here are the budgets that they share.

``QUICK``, in each file, is for 12k steps of batch 256, what a CPU has time for: rates are raised, and no claim is made
that so few steps suffice. ``DEMO`` and ``SMOKE`` shrink batch and networks further: the first is for a table within
minutes, the second shows only that everything runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

DEMO: Mapping[str, Any] = {"batch_size": 128, "hidden": (128, 128)}
SMOKE: Mapping[str, Any] = {"batch_size": 32, "hidden": (32, 32)}
