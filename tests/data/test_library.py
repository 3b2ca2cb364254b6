"""Where files lie, and that one is what it was when it was first used."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from helpers_files import make_episodes, write_d4rl, write_minari

from lfobench.contract.suite import DataFile, own_file
from lfobench.data import library as library_module
from lfobench.data.library import Library
from lfobench.errors import UserError

FILE = DataFile("there-v2", ("https://example.org/there.hdf5",))


@pytest.fixture
def library(tmp_path: Path) -> Library:
    return Library(tmp_path / "cache")


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    return write_d4rl(tmp_path / "there.hdf5", make_episodes())


def test_a_file_that_is_not_here_stays_as_it_is(library: Library) -> None:
    assert library.find(FILE, "d4rl") == FILE


def test_a_file_that_is_adopted_stays_where_it_is(library: Library, outside: Path) -> None:
    note = library.register("d4rl", FILE, outside)
    found = library.find(FILE, "d4rl")
    assert (found.path, found.sha256) == (str(outside), note.sha256)
    library.forget("d4rl", FILE)
    assert outside.exists()
    assert library.find(FILE, "d4rl") == FILE


def test_a_download_is_found(library: Library, outside: Path) -> None:
    place = library.place("d4rl", FILE)
    place.parent.mkdir(parents=True)
    place.write_bytes(outside.read_bytes())
    found = library.find(FILE, "d4rl")
    assert found.path == str(place)
    assert library.note("d4rl", FILE) is not None, "its hash is recorded on first use"


def test_another_content_under_the_same_name_is_refused(library: Library, outside: Path) -> None:
    library.register("d4rl", FILE, outside)
    write_d4rl(outside, make_episodes((3, 3), (True, True)))
    for use in (lambda: library.find(FILE, "d4rl"), lambda: library.verify("d4rl", FILE)):
        with pytest.raises(UserError, match=r"there-v2 .*SHA-256"):
            use()


def test_a_file_that_was_moved_away_is_not_passed_over(library: Library, outside: Path) -> None:
    assert library.verify("d4rl", FILE) is None, "never here"
    library.register("d4rl", FILE, outside)
    outside.rename(outside.with_name("elsewhere.hdf5"))
    with pytest.raises(UserError, match=rf"there-v2 .*{outside}.*lfobench data download"):
        library.verify("d4rl", FILE)
    assert library.find(FILE, "d4rl") == FILE


def test_a_file_that_was_only_touched_is_the_same(library: Library, outside: Path) -> None:
    note = library.register("d4rl", FILE, outside)
    os.utime(outside, (1, 1))
    assert library.find(FILE, "d4rl").sha256 == note.sha256
    touched = library.note("d4rl", FILE)
    assert touched is not None and touched.stamp != note.stamp


def test_bytes_changed_behind_unchanged_times_are_found_by_verify(library: Library, outside: Path) -> None:
    note = library.register("d4rl", FILE, outside)
    content = bytearray(outside.read_bytes())
    content[-1] ^= 1
    outside.write_bytes(content)
    pretended = note.model_copy(
        update={"stamp": (len(content), outside.stat().st_mtime_ns, outside.stat().st_ctime_ns)}
    )
    (library.folder("d4rl") / f"{FILE.name}.json").write_text(pretended.model_dump_json())
    assert library.find(FILE, "d4rl").sha256 == note.sha256
    with pytest.raises(UserError, match=r"there-v2 .*SHA-256"):
        library.verify("d4rl", FILE)


@pytest.mark.parametrize("damage", ["", "{}", "[1]", '{"path": "/etc/passwd"}'])
def test_a_damaged_note_is_no_licence_to_take_another_file(library: Library, outside: Path, damage: str) -> None:
    library.register("d4rl", FILE, outside)
    note = library.folder("d4rl") / f"{FILE.name}.json"
    note.write_text(damage)
    with pytest.raises(UserError, match=r"damaged.*there-v2"):
        library.find(FILE, "d4rl")
    note.unlink()
    assert library.find(FILE, "d4rl") == FILE, "an adopted file is forgotten with its note"


def test_a_note_that_cannot_be_read_is_no_licence_either(library: Library, outside: Path) -> None:
    (library.folder("d4rl") / f"{FILE.name}.json").mkdir(parents=True)
    with pytest.raises(UserError, match=r"cannot be read .*there-v2"):
        library.register("d4rl", FILE, outside)


def test_a_file_that_is_written_to_has_no_hash(
    library: Library, outside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = library_module.sha256

    def while_written(path: Path) -> str:
        found = real(path)
        with path.open("ab") as file:
            file.write(b"more")
        return found

    monkeypatch.setattr(library_module, "sha256", while_written)
    with pytest.raises(UserError, match=f"{outside} is being written"):
        library.register("d4rl", FILE, outside)


def test_an_own_file_is_taken_as_it_is_now(library: Library, outside: Path) -> None:
    first = library.find(own_file(str(outside)), "files")
    assert library.find(own_file(str(outside)), "files") == first
    write_d4rl(outside, make_episodes((3, 3), (True, True)))
    assert library.find(own_file(str(outside)), "files").sha256 != first.sha256
    with pytest.raises(UserError, match=r"none\.hdf5.*--source"):
        library.find(own_file(str(outside.with_name("none.hdf5"))), "files")


def test_two_own_files_of_one_name(library: Library, tmp_path: Path) -> None:
    found = []
    for folder, lengths in (("one", (3,)), ("two", (4,))):
        (tmp_path / folder).mkdir()
        path = write_d4rl(tmp_path / folder / "data.hdf5", make_episodes(lengths, (True,)))
        found.append(library.find(own_file(str(path)), "files"))
    assert found[0].sha256 != found[1].sha256


def test_a_minari_dataset_is_hashed_by_its_data(library: Library, tmp_path: Path) -> None:
    (tmp_path / "dataset" / "data").mkdir(parents=True)
    write_minari(tmp_path / "dataset" / "data" / "main_data.hdf5", make_episodes())
    assert library.find(own_file(str(tmp_path / "dataset")), "files").sha256
    with pytest.raises(UserError, match=r"Minari.*LeRobot"):
        library.find(own_file(str(tmp_path)), "files")


def test_a_cache_that_cannot_be_written_only_costs_time(tmp_path: Path, outside: Path) -> None:
    (tmp_path / "cache").write_text("a file")
    assert Library(tmp_path / "cache").find(own_file(str(outside)), "files").sha256
