"""Files that several processes share: temporary names, leftovers, locks, and what is no file at all."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from lfobench import files
from lfobench.errors import UserError
from lfobench.files import (
    LEFTOVER_DAYS,
    TEMPORARY_SUFFIX,
    Held,
    is_held,
    locked,
    read_within,
    remove_leftovers,
    replacing,
)

DAY = 86_400.0


def temporary_files(folder: Path) -> list[Path]:
    return sorted(folder.rglob(f"*{TEMPORARY_SUFFIX}"))


def dead_process() -> int:
    """The id of a process that is no more."""
    with subprocess.Popen([sys.executable, "-c", ""]) as child:
        child.wait()
    return child.pid


def written_by(process: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What a process of that number leaves when it is killed in the middle of a write."""
    with monkeypatch.context() as patch:
        patch.setattr(os, "getpid", lambda: process)
        leftover = files._temporary_in(folder)
    leftover.write_bytes(b"half a file")
    return leftover


def on_another_host(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(files, "_place", lambda: "0123456789ab")


# --- temporary files -------------------------------------------------------------------------------------------------


def test_leftovers_of_a_killed_process_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed = written_by(dead_process(), tmp_path, monkeypatch)
    (tmp_path / "00001.safetensors").write_bytes(b"whole")
    remove_leftovers(tmp_path)
    assert not killed.exists()
    assert (tmp_path / "00001.safetensors").exists()


def test_a_living_process_keeps_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with replacing(tmp_path / "file") as temporary:
        temporary.write_text("half")
        remove_leftovers(tmp_path)
        temporary.write_text("whole")
    assert (tmp_path / "file").read_text() == "whole"
    assert temporary_files(tmp_path) == []


def test_a_process_of_another_host_or_container_is_not_judged_by_its_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its number is nobody's here, and it may be writing."""
    with monkeypatch.context() as patch:
        on_another_host(patch)
        theirs = written_by(dead_process(), tmp_path, patch)
    remove_leftovers(tmp_path)
    assert theirs.exists()
    old = time.time() - (LEFTOVER_DAYS + 0.5) * DAY
    os.utime(theirs, (old, old))
    remove_leftovers(tmp_path)
    assert not theirs.exists(), "a week without a byte is no write"


def test_names_of_the_old_form_age_too(tmp_path: Path) -> None:
    for name in (f"record.json.1234{TEMPORARY_SUFFIX}", f".lfobench-77{TEMPORARY_SUFFIX}"):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path)
    assert len(temporary_files(tmp_path)) == 2
    old = time.time() - (LEFTOVER_DAYS + 0.5) * DAY
    for path in temporary_files(tmp_path):
        os.utime(path, (old, old))
    remove_leftovers(tmp_path)
    assert temporary_files(tmp_path) == []


def test_equal_process_numbers_never_share_a_temporary_file(tmp_path: Path) -> None:
    """Two containers, two threads: each writes its own, and the last one's file is whole."""
    target = tmp_path / "file"
    with replacing(target) as one:
        with replacing(target) as two:
            assert one != two
            one.write_text("one")
            two.write_text("two")
        assert target.read_text() == "two"
    assert target.read_text() == "one"


def test_a_place_is_named_in_the_file(tmp_path: Path) -> None:
    with replacing(tmp_path / ("x" * 250)) as temporary:
        assert re.fullmatch(rf"\.{files._place()}-{os.getpid()}-[0-9a-f]{{8}}{TEMPORARY_SUFFIX}", temporary.name)
        temporary.touch()
    assert (tmp_path / ("x" * 250)).exists(), "a long name leaves room for no longer one"


# --- reading ---------------------------------------------------------------------------------------------------------


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ValueError, match="not a regular file"):
        read_within(tmp_path / "pipe", 100)


def test_what_has_no_end_is_not_begun(tmp_path: Path) -> None:
    (tmp_path / "endless").symlink_to("/dev/zero")
    with pytest.raises(ValueError, match="not a regular file"):
        read_within(tmp_path / "endless", 100)


def test_what_is_too_large_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"x" * 101)
    with pytest.raises(ValueError, match="101 bytes, and at most 100"):
        read_within(tmp_path / "file", 100)
    assert read_within(tmp_path / "file", 101) == b"x" * 101


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="directory"):
        read_within(tmp_path, 100)


# --- locks -----------------------------------------------------------------------------------------------------------


def test_a_lock_is_held_by_one_and_leaves_nothing(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    with locked(lock, "--out"), pytest.raises(Held), locked(lock, "--out"):
        pytest.fail("held twice")
    with locked(lock, "--out"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_lock_whose_file_was_deleted_meanwhile_is_taken_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its holder deletes it between our opening and our locking: that inode guards no name any more."""
    lock, genuine, calls = tmp_path / "lock", fcntl.flock, []

    def late(descriptor: int, how: int) -> None:
        calls.append(descriptor)
        if len(calls) == 1:
            lock.unlink()
        genuine(descriptor, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with locked(lock, "--out"):
        assert len(calls) == 2
        with pytest.raises(Held), locked(lock, "--out"):
            pytest.fail("held twice")


def test_the_system_lets_go_of_a_dead_process_lock(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    hold = (
        "import sys, time; from pathlib import Path; from lfobench.files import locked\n"
        "with locked(Path(sys.argv[1]), '--out'):\n    print('held', flush=True)\n    time.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", hold, str(lock)], stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(Held), locked(lock, "--out"):
            pytest.fail("held twice")
        holder.send_signal(signal.SIGKILL)
        with locked(lock, "--out", wait=True):
            pass


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_is_named(code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(UserError, match=os.strerror(code)) as caught, locked(tmp_path / "lock", "--out", wait=True):
        pytest.fail("not held")
    assert str(tmp_path) in caught.value.problem
    assert "--out" in caught.value.remedy


def test_a_look_at_a_lock_takes_it_from_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever wants the lock while others look waits for them, and does not take them for its holder."""
    lock = tmp_path / "lock"
    assert not is_held(lock, "--out")
    assert list(tmp_path.iterdir()) == []
    lock.touch()
    looking, waits = os.open(lock, os.O_RDWR), []
    fcntl.flock(looking, fcntl.LOCK_SH)

    def ends(seconds: float) -> None:
        waits.append(seconds)
        os.close(looking)

    monkeypatch.setattr(time, "sleep", ends)
    assert not is_held(lock, "--out"), "two may look at once"
    with locked(lock, "--out"):
        assert len(waits) == 1
        assert is_held(lock, "--out")
    assert not is_held(lock, "--out")


def test_a_lock_of_another_user_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> int:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(UserError, match="Permission denied") as caught, locked(tmp_path / "a.lock", "--out", wait=True):
        pytest.fail("not held")
    assert str(tmp_path / "a.lock") in caught.value.problem
    with pytest.raises(UserError, match=r"a\.lock"):
        is_held(tmp_path / "a.lock", "--out")


def test_leftovers_that_may_not_be_deleted_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leftovers = [written_by(dead_process(), tmp_path, monkeypatch) for _ in range(2)]
    genuine = Path.unlink

    def unlink(path: Path, missing_ok: bool = False) -> None:
        if path == leftovers[0]:
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))
        genuine(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", unlink)
    remove_leftovers(tmp_path)
    assert temporary_files(tmp_path) == leftovers[:1]
