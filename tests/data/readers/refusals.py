"""Refused files: the problem of one, and the sentences of all in a golden file per layout."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pytest
from helpers_golden import check_golden

from lfobench.data.readers.formats import read
from lfobench.data.readers.hdf5 import FileProblem
from lfobench.data.readers.reading import check

GOLDEN = Path(__file__).parent / "golden"


def problem_of(path: Path, *facts: str) -> FileProblem:
    """The problem for which a file is refused; its cause holds the facts, and it has a remedy."""
    with pytest.raises(FileProblem) as caught:
        check(read(path))
    assert all(fact in caught.value.cause for fact in facts), caught.value.cause
    assert caught.value.remedy.endswith(".")
    return caught.value


def check_refusals(problems: Mapping[str, FileProblem], layout: str) -> None:
    """Cause and remedy per case; a library's own text at the end of a cause is left out, because versions differ."""
    lines = [
        f"{case}: {re.sub(r' [(](?!there: )[^()]*[)]$', '', problem.cause)}\n    {problem.remedy}\n"
        for case, problem in problems.items()
    ]
    check_golden("".join(lines), GOLDEN / f"refused_{layout}.txt")
