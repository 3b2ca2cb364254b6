"""What every test stands on: one thread, one data cache per session, a command line to call."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers_folders import with_provenance
from helpers_records import make_cell, make_record

import lfobench  # noqa: F401 - sets up MKL, which reads its settings when torch loads it
from lfobench.record import Failure, Record
from lfobench.tables.building import build_table
from lfobench.tables.table import Table

# isort: split
import torch
from helpers_cli import InProcess
from hypothesis import settings

settings.register_profile("lfobench", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("lfobench")


@pytest.fixture(autouse=True, scope="session")
def one_thread_everywhere() -> Iterator[None]:
    """Tiny products gain nothing from threads, and the suite shares its cores; child processes do the same."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    os.environ["OMP_NUM_THREADS"] = "1"
    yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True, scope="session")
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """One dataset cache for the session, so that generated data is made once even under pytest-xdist."""
    base = tmp_path_factory.getbasetemp()
    root = (base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base) / "lfobench-cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LFOBENCH_CACHE", str(root))
        patch.setenv("COLUMNS", "200")
        yield root


@pytest.fixture
def lfobench_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> InProcess:
    """The command line, called in this process: ``lfobench_command("ls", "methods").code``."""
    return InProcess(monkeypatch, capsys)


@pytest.fixture
def full_disk() -> Iterator[None]:
    """No file grows beyond 256 KiB: the system refuses in the middle of a write, as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (256 * 1024, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(name="make_record")
def _make_record() -> Callable[..., Record]:
    return make_record


@pytest.fixture(name="make_cell")
def _make_cell() -> Callable[..., list[Record]]:
    return make_cell


@pytest.fixture
def example() -> list[Record]:
    """Two blocks of two tasks, five methods, one diverged seed, one missing cell."""
    records: list[Record] = []
    steps = {"random+expert": 300_000, "random+few-expert": 500_000}
    for group, scale in (("random+expert", 1.0), ("random+few-expert", 0.5)):
        for row in ("hopper", "halfcheetah"):
            place: dict[str, Any] = {
                "row": row,
                "group": group,
                "protocol": {
                    "name": "paper",
                    "steps": steps[group],
                    "steps_assigned": False,
                    "evaluation_every": 5000,
                    "evaluation_episodes": 10,
                },
            }
            records += make_cell([5.1 * scale, 4.2, 3.9], "bc-expert", sees_expert_actions=True, **place)
            records += make_cell([45.0 * scale, 50.0, 41.0], "bc", sees_expert_actions=True, **place)
            if (row, group) != ("halfcheetah", "random+few-expert"):
                records += make_cell([60.0 * scale, 75.0, 30.0], "oril", **place)
            records += make_cell([100.0 * scale, 100.6, 99.1], "smodice", **place)
            records += make_cell([103.2, 97.9, 101.5], "dilo", **place)
    first = records.index(next(record for record in records if record.method == "smodice"))
    smodice = records[first]
    records[first] = smodice.model_copy(update={"status": "diverged", "diverged_at": 12_000})
    return records


@pytest.fixture
def marked() -> Table:
    """Every mark: a dagger, diverged seeds, failed seeds, a cell of failures alone, one seed, the demonstration."""
    records = [
        *make_cell([45.0, 50.0, 41.0], "bc", sees_expert_actions=True),
        *make_cell([84.0, 90.0, 94.0], "oril"),
        *make_cell([96.0, 100.0, 104.0]),
        *make_cell([95.0, 99.0, 104.0], "oril", row="halfcheetah"),
        *make_cell([96.0, 100.0, 104.0], row="halfcheetah"),
        *make_cell([9.0], row="walker2d"),
        *make_cell([5.0, 6.0, 7.5], "oril", row="ant"),
        *make_cell([101.0, 0.0, 99.0], row="ant"),
    ]
    records[-2] = make_record(0.0, seed=1, row="ant", diverged_at=300)
    crashed = [
        make_record(0.0, "oril", 0, row="walker2d"),
        make_record(0.0, "oril", 1, row="walker2d"),
        make_record(0.0, seed=3, row="ant"),
        make_record(0.0, seed=4, row="ant"),
    ]
    failures = [
        Failure(identity_hash=one.identity_hash, identity=one.identity, labels=one.labels, error="x", traceback=[])
        for one in crashed
    ]
    shown = [with_provenance(record, demonstration_score=103.27) for record in records if record.labels.row != "ant"]
    return build_table([*shown, *records[-6:]], failures=failures)
