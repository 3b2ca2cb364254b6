"""Files that other processes read and write too: written whole or not at all, read within bounds, locked."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import re
import secrets
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from safetensors import SafetensorError

from lfobench.errors import UserError

TEMPORARY_SUFFIX = ".lfobench-partial"
LEFTOVER_DAYS = 7.0
"""After so many days without a byte, a temporary file is nobody's, whoever began it."""
POLL_SECONDS = 0.1
LOOK_SECONDS = 0.001

_HELD = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES}
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL}


def cache_folder() -> Path:
    """``LFOBENCH_CACHE``, or the platform's cache folder."""
    import platformdirs

    chosen = os.environ.get("LFOBENCH_CACHE")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("lfobench"))


def exists(path: Path) -> bool:
    """Whether there is anything at `path`.

    Raises:
        UserError: nobody can tell, because a folder on the way may not be entered, or the name is too long.
    """
    try:
        return path.exists()
    except OSError as error:
        raise UserError(f"Cannot look at {path}: {error.strerror}.", "Name another path, or allow it.") from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name, durably, if the block succeeds.

    Raises:
        UserError: when the disk refuses (full, read-only, no permission).
    """
    temporary = _temporary_in(path.parent)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)
        permissions = temporary.stat().st_mode
        yield temporary
        temporary.chmod(permissions)  # safetensors makes files that nobody else may read
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    except (OSError, SafetensorError) as error:
        raise UserError(
            f"Cannot write {path}: {getattr(error, 'strerror', None) or error}.", "Free space or choose another folder."
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def cannot_delete(path: Path, error: OSError) -> UserError:
    """The error for what the disk does not let go."""
    return UserError(f"Cannot delete {path}: {error.strerror or error}.", "Delete it by hand, or allow it.")


def _sync_folder(folder: Path) -> None:
    """Make a rename in `folder` survive a power cut, where the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path`, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _temporary_in(folder: Path) -> Path:
    """A name that no other process takes: not on this host, not on another one, not in a container of the same pid."""
    return folder / f".{_place()}-{os.getpid()}-{secrets.token_hex(4)}{TEMPORARY_SUFFIX}"


@cache
def _place() -> str:
    """Where a process number means one process: a host between two starts, and of its containers one."""
    parts = [socket.gethostname()]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip())
    with suppress(OSError):
        parts.append(str(Path("/proc/self/ns/pid").readlink()))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:12]


def remove_leftovers(folder: Path) -> None:
    """Delete temporary files below `folder` that nobody writes any more.

    Those of this place whose process is gone, and those of any place that are older than `LEFTOVER_DAYS`.
    """
    for leftover in folder.rglob(f"*{TEMPORARY_SUFFIX}"):
        with suppress(OSError):  # gone meanwhile, or another user's
            writer = re.fullmatch(rf"\.{_place()}-([0-9]+)-.*", leftover.name)
            gone = writer is not None and not _alive(int(writer[1]))
            if gone or time.time() - leftover.stat().st_mtime > LEFTOVER_DAYS * 86_400.0:
                leftover.unlink()


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def writable_folder(path: Path, option: str) -> Path:
    """Make sure that `path` is a folder that files can be made in.

    Raises:
        UserError: naming the folder, the cause and the option that chooses another.
    """
    probe = _temporary_in(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.touch()
    except OSError as error:
        raise UserError(
            f"Cannot write into {path}: {error.strerror}.", f"Choose another folder with {option}."
        ) from error
    finally:
        with suppress(OSError):
            probe.unlink()
    return path


def read_within(path: Path, most: int) -> bytes:
    """All bytes of a regular file; waits for no pipe, and begins nothing that has no end.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no regular file, or holds more than `most` bytes.
    """
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY), "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise ValueError("it is not a regular file")
        if found.st_size > most:
            raise ValueError(f"it has {found.st_size:,} bytes, and at most {most:,} are read")
        return file.read(found.st_size + 1)


class Held(Exception):
    """Another process holds the lock."""


@contextmanager
def locked(path: Path, option: str, wait: bool = False) -> Iterator[None]:
    """Hold the lock `path` inside the block; the system lets go of it when this process ends, however it does.

    Args:
        path: the lock's file, which is made, and deleted afterwards.
        option: chooses another folder.
        wait: for whoever holds it.

    Raises:
        Held: another process does, unless that is waited for.
        UserError: the file cannot be opened, as another user's, or its file system has no locks.
        FileNotFoundError: there is no folder for it.
    """
    while (descriptor := _lock(path, option)) is None:
        if not wait:
            raise Held
        time.sleep(POLL_SECONDS)
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()  # before it is let go: whoever takes it then sees that the name is free again
        os.close(descriptor)


def is_held(path: Path, option: str) -> bool:
    """Whether a process holds the lock `path`; to whoever takes it at the same moment, this is not seen.

    Raises:
        UserError: as `locked`.
    """
    try:
        descriptor = _open_lock(path, os.O_RDWR, option)
    except FileNotFoundError:
        return False
    try:
        return not _flock(descriptor, fcntl.LOCK_SH, path, option)
    finally:
        os.close(descriptor)


def _lock(path: Path, option: str) -> int | None:
    """The descriptor of a lock that was free; None where it is held."""
    while True:
        descriptor, ours = _open_lock(path, os.O_RDWR | os.O_CREAT, option), False
        try:
            if _flock(descriptor, fcntl.LOCK_EX, path, option):
                # Whoever held it may have deleted it between our opening and our locking it.
                with suppress(FileNotFoundError):
                    ours = os.path.samestat(os.fstat(descriptor), path.stat())
                if ours:
                    return descriptor
            elif _flock(descriptor, fcntl.LOCK_SH, path, option):
                time.sleep(LOOK_SECONDS)  # shared by others: they only look at it, see `is_held`
            else:
                return None
        finally:
            if not ours:
                os.close(descriptor)


def _open_lock(path: Path, how: int, option: str) -> int:
    try:
        return os.open(path, how | os.O_NONBLOCK, 0o666)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise UserError(
            f"Cannot open the lock {path}: {error.strerror}.",
            f"Let its owner delete or share it, or choose another folder with {option}.",
        ) from error


def _flock(descriptor: int, how: int, path: Path, option: str) -> bool:
    """Whether the system gave a lock at once."""
    try:
        fcntl.flock(descriptor, how | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _HELD:
            return False
        if error.errno in _NO_LOCKS:
            raise UserError(
                f"The file system of {path.parent} has no file locks ({error.strerror}), so that two commands "
                "could do the same work.",
                f"Choose a folder on a local disk with {option}, and copy the results afterwards.",
            ) from error
        raise
    return True
