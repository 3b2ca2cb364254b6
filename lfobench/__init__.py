"""lfobench: a benchmark of offline learning from observation.

Packages in the order in which data flows: ``cells``, ``data``, ``engine`` and ``schedule``, ``records``, ``stats``,
``tables`` with ``analyses``, ``plots`` and ``html_report``. ``contract`` holds what methods and suites agree on
with the harness, ``nn`` the blocks that methods are built of.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from lfobench import shipped

if TYPE_CHECKING:
    from lfobench.api import export, plot, report, run, table
    from lfobench.records.frame import load

__all__ = [
    "__version__",
    "audit",
    "check",
    "compare",
    "export",
    "load",
    "outcomes",
    "plot",
    "power",
    "report",
    "run",
    "select_records",
    "table",
    "video",
]

__version__ = "0.1.0"

# Entry points and pickles name `methods.…` and `suites.…`, and mean the packages that ship.
shipped.put_first()

# MKL's products may otherwise round differently with the memory alignment of their operands, and then a seed
# trained beside others would not repeat the same seed trained alone. Read when the library loads, hence here.
os.environ.setdefault("MKL_CBWR", "AUTO,STRICT")

# Threads that spin while they wait for others cost a process with two threads on busy cores fifty times its time.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def __getattr__(name: str) -> Any:
    """What Python users call, loaded when it is first used: `import lfobench` is instant."""
    if name not in __all__:
        raise AttributeError(f"module 'lfobench' has no attribute '{name}'")
    if name == "load":
        from lfobench.records.frame import load

        return load
    from lfobench import api

    return getattr(api, name)
