"""Datasets that Minari's own tool brings: looked at like any other file, and refused in our words."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from helpers_files import make_episodes, write_minari

from lfobench.data import library as fetching
from lfobench.data.library import Library, Wanted, download, wanted_files
from lfobench.errors import UserError
from suites.locomotion import SUITE

IDENTIFIER = "mujoco/hopper/medium-v0"


@pytest.fixture
def wanted() -> Wanted:
    [task] = [task for task in SUITE.tasks if task.name == "hopper-medium-expert"]
    return next(each for each in wanted_files([task], ["minari"]) if each.file.name == "mujoco-hopper-medium-v0")


def install(monkeypatch: pytest.MonkeyPatch, datasets: Path, download: Callable[[str], None]) -> None:
    """A stand-in for the package, with the two functions that are used of it."""
    package, storage, local = (ModuleType(name) for name in ("minari", "minari.storage", "minari.storage.local"))
    package.download_dataset = download  # type: ignore[attr-defined]
    local.get_dataset_path = lambda identifier: datasets / identifier  # type: ignore[attr-defined]
    for module in (package, storage, local):
        monkeypatch.setitem(sys.modules, module.__name__, module)


def arrives(datasets: Path, columns: int) -> Callable[[str], None]:
    def download(identifier: str) -> None:
        place = datasets / identifier / "data" / "main_data.hdf5"
        place.parent.mkdir(parents=True)
        write_minari(place, make_episodes(observation=columns, action=3))

    return download


def test_what_arrives_is_noted_where_it_lies(tmp_path: Path, wanted: Wanted, monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, tmp_path, arrives(tmp_path, 11))
    library = Library(tmp_path / "cache")
    note = download(library, wanted, lambda here, total: None)
    assert (note.path, note.address) == (str(tmp_path / IDENTIFIER), f"minari:{IDENTIFIER}")
    assert library.find(wanted.file, "minari").sha256 == note.sha256


def test_a_dataset_of_another_environment_is_refused(
    tmp_path: Path, wanted: Wanted, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(monkeypatch, tmp_path, arrives(tmp_path, 17))
    library = Library(tmp_path / "cache")
    with pytest.raises(UserError, match=r"observations.* 17 .*Hopper-v5 11"):
        download(library, wanted, lambda here, total: None)
    assert library.note("minari", wanted.file) is None


def test_an_error_of_the_tool_is_reported(tmp_path: Path, wanted: Wanted, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(identifier: str) -> None:
        raise ConnectionError("Name or service not known")

    install(monkeypatch, tmp_path, fails)
    with pytest.raises(UserError, match=rf"{IDENTIFIER} .*Name or service not known.*--from DIR"):
        download(Library(tmp_path / "cache"), wanted, lambda here, total: None)


def test_a_missing_package_says_how_it_is_installed(
    tmp_path: Path, wanted: Wanted, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(UserError, match=r"pip install 'lfobench\[minari\]'"):
        download(Library(tmp_path / "cache"), wanted, lambda here, total: None)


@pytest.mark.parametrize(
    ("start", "said"),
    [
        (b"\x89HDF\r\n\x1a\n\0", ""),
        (b"PK\x03\x04\x14", ""),
        (b"\n <!DOCTYPE html><title>Log in", "web page"),
        (b'{"error": "quota"}', "JSON"),
        (b"version https://git-lfs.github.com/spec/v1", "Git LFS"),
        (bytes(512), "HDF5"),
    ],
)
def test_first_bytes_that_are_no_data_are_named(start: bytes, said: str) -> None:
    problem = fetching._not_data(start)
    assert said in problem
    assert bool(said) == bool(problem)
