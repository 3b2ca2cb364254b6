"""The cores of this process, and worker processes that leave interrupts to their parent and never outlive it."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker

# malloc.h
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold SIGINT, SIGTERM and SIGHUP back inside the block; processes started in it never see one.

    Terminals and schedulers signal the whole process group. Only the parent may act on it, also while a worker
    is still importing its modules; a parent that dies takes its workers along by `die_with_parent`.
    """
    # The first process or lock of an interpreter starts this tracker. It ignores the first two signals, and lets them
    # through again in this process; the third it would die of.
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    resource_tracker.ensure_running()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)


def die_with_parent() -> None:
    """Called in a worker: end it at once when its parent is gone, so that nothing runs unseen."""
    threading.Thread(target=_outlive_nobody, daemon=True).start()


def _outlive_nobody() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def keep_freed_memory() -> None:
    """Let the C library keep large freed blocks for the next step instead of returning them to the system.

    A training step allocates and frees the same megabytes every time; returned, they come back as page faults.
    """
    with suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt  # glibc's; other C libraries have none
        mallopt(_M_MMAP_THRESHOLD, 1 << 30)
        mallopt(_M_TRIM_THRESHOLD, 1 << 30)
