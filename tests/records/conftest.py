"""A run and an output folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers_engine import smoke_cell

from lfobench.cells.cell import Run
from lfobench.records.folder import RecordFolder


@pytest.fixture
def run() -> Run:
    return Run(smoke_cell("bc"), 3)


@pytest.fixture
def folder(tmp_path: Path) -> RecordFolder:
    return RecordFolder(tmp_path / "out")
