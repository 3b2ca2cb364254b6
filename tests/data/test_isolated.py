"""A file becomes a shard in a process of its own, whole or not at all."""

from __future__ import annotations

import hashlib
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_files import make_episodes, write_d4rl

from lfobench.cells.parts import FilePart
from lfobench.data import isolated
from lfobench.data.cache import PartCache
from lfobench.data.isolated import examine_file, import_file
from lfobench.errors import UserError

PART = FilePart("small", sha256="5" * 64, horizon=9)


def part_of(path: Path) -> FilePart:
    return replace(PART, sha256=hashlib.sha256(path.read_bytes()).hexdigest())


def test_the_shard_holds_the_file_s_episodes(tmp_path: Path) -> None:
    episodes = make_episodes()
    path = write_d4rl(tmp_path / "file.hdf5", episodes)
    part = part_of(path)
    import_file(tmp_path / "cache", path, part)
    cache = PartCache(tmp_path / "cache", part)
    assert cache.missing(None) == []
    assert cache.folder == tmp_path / "cache" / "imported" / part.folder
    found, mark = cache.load(None, "again")
    np.testing.assert_array_equal(found.observations, episodes.observations)
    assert len(mark) == 64


def test_the_name_of_a_file_is_not_what_it_is() -> None:
    assert FilePart("other", PART.sha256, PART.horizon).hash == PART.hash
    assert len({part.hash for part in (PART, FilePart("small", "6" * 64, 9), FilePart("small", "5" * 64, 8))}) == 3


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"<html>Log in</html>", "web page"),
        (None, "No such file or directory"),
    ],
)
def test_a_bad_file_leaves_nothing(tmp_path: Path, content: bytes | None, said: str) -> None:
    path = tmp_path / "file.hdf5"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError, match=said) as caught:
        import_file(tmp_path / "cache", path, PART)
    assert str(path) in caught.value.problem
    assert not (tmp_path / "cache").exists()


def test_a_reader_that_dies_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = subprocess.run

    def dying(command: list[str], **options: object) -> object:
        kill = f"import os, signal; os.kill(os.getpid(), signal.{signal.SIGSEGV.name})"
        return real([command[0], "-c", kill], **options)  # type: ignore[call-overload]

    monkeypatch.setattr(isolated.subprocess, "run", dying)
    with pytest.raises(UserError, match=r"file\.hdf5 .*SIGSEGV"):
        import_file(tmp_path / "cache", tmp_path / "file.hdf5", PART)


def test_a_reader_that_takes_for_ever_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isolated, "SECONDS", 0.01)
    with pytest.raises(UserError, match="0 minutes"):
        import_file(tmp_path / "cache", write_d4rl(tmp_path / "file.hdf5", make_episodes()), PART)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_cache_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir(mode=0o500)
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with pytest.raises(UserError, match="Cannot write"):
        import_file(tmp_path / "cache", path, part_of(path))


@pytest.fixture
def small_files_only() -> Iterator[None]:
    """As on a disk that is full after 4096 bytes; processes that are started inherit it."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_leaves_nothing(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes([100] * 10, [False] * 10))
    part = part_of(path)
    request.getfixturevalue("small_files_only")
    with pytest.raises(UserError, match=r"00000\.safetensors: .*Free space"):
        import_file(tmp_path / "cache", path, part)
    assert not [found for found in (tmp_path / "cache").rglob("*") if found.is_file()]


def test_a_file_that_changed_since_it_was_planned_for_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"file\.hdf5 .*changed.*Run the command again"):
        import_file(tmp_path / "cache", write_d4rl(tmp_path / "file.hdf5", make_episodes()), PART)
    assert not (tmp_path / "cache").exists()


def test_no_module_next_to_a_file_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    for module in ("h5py", "resource", "numpy"):
        (tmp_path / f"{module}.py").write_text("import pathlib; pathlib.Path('ran').touch()")
    monkeypatch.chdir(tmp_path)
    assert examine_file(path, 9).usable
    assert not (tmp_path / "ran").exists()


def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UserError, match=r"pipe .*neither a file nor a folder"):
        examine_file(tmp_path / "pipe", 9)


def test_the_process_loads_no_more_than_it_needs() -> None:
    """Torch would take longer to load than most files take to read."""
    code = "import sys, lfobench.data.isolated; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_a_file_is_examined_without_the_cache(tmp_path: Path) -> None:
    found = examine_file(write_d4rl(tmp_path / "file.hdf5", make_episodes()), 9)
    assert (found.format, found.lengths, found.terminated) == ("d4rl", (7, 4, 9), 1)
    assert [finding.code for finding in found.findings] == ["early-timeouts"]
    with pytest.raises(UserError, match=r"none\.hdf5 .*No such file"):
        examine_file(tmp_path / "none.hdf5", None)
