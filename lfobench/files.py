"""Writing files so that a reader never sees half of one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from safetensors import SafetensorError

from lfobench.errors import UserError

TEMPORARY_SUFFIX = ".lfobench-partial"


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
    temporary = path.with_name(f"{path.name}.{os.getpid()}{TEMPORARY_SUFFIX}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch()
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


def remove_leftovers(folder: Path) -> None:
    """Delete temporary files below `folder` whose writing process no longer lives."""
    for leftover in folder.rglob(f"*{TEMPORARY_SUFFIX}"):
        writer = leftover.name.removesuffix(TEMPORARY_SUFFIX).rpartition(".")[2]
        if writer.isdigit() and not _alive(int(writer)):
            leftover.unlink(missing_ok=True)


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
    probe = path / f".lfobench-{os.getpid()}{TEMPORARY_SUFFIX}"
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
