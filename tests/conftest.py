"""What every test stands on: one thread, one data cache per session, a command line to call."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest

import lfobench  # noqa: F401 - sets up MKL, which reads its settings when torch loads it

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
