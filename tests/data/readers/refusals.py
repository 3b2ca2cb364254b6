"""Sentences of refused files, kept in one golden file per layout."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from helpers_golden import check_golden

from lfobench.data.readers.hdf5 import FileProblem

GOLDEN = Path(__file__).parent / "golden"


def check_refusals(problems: Mapping[str, FileProblem], layout: str) -> None:
    """Cause and remedy per case; a library's own text at the end of a cause is left out, because versions differ."""
    lines = [
        f"{case}: {re.sub(r' [(](?!there: )[^()]*[)]$', '', problem.cause)}\n    {problem.remedy}\n"
        for case, problem in problems.items()
    ]
    check_golden("".join(lines), GOLDEN / f"refused_{layout}.txt")
