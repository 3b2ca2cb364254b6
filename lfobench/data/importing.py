"""Files become shards: each is read once, in a process of its own, and from then on the cache is read.

A file from outside can make the HDF5 library loop, take all memory or crash; what happens to that process happens to
it alone. It loads no plugin, and it ends in one of three ways: the shard is there, it says why not, or it is dead.

Run as ``python -m lfobench.data.importing``, with the order as JSON on standard input.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

from lfobench.data.cache import PartCache
from lfobench.data.readers.checks import check
from lfobench.data.readers.formats import read
from lfobench.data.readers.hdf5 import OTHER, FileProblem
from lfobench.errors import UserError
from lfobench.plan.file_parts import FilePart

REFUSED = 3
SECONDS = 1_800.0
"""After which a file is given up; one of a million transitions takes seconds."""


def import_file(root: Path, path: Path, part: FilePart) -> None:
    """Make the shard of a file, whole or not at all.

    Args:
        root: of the cache.
        path: the file.
        part: what it is.

    Raises:
        UserError: naming the file, what is wrong with it, and the way out.
    """
    order = json.dumps({"root": str(root), "path": str(path), "part": asdict(part)})
    environment = {**os.environ, "HDF5_PLUGIN_PRELOAD": "::", "HDF5_USE_FILE_LOCKING": "FALSE"}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "lfobench.data.importing"],
            input=order,
            capture_output=True,
            text=True,
            timeout=SECONDS,
            env=environment,
        )
    except subprocess.TimeoutExpired as error:
        raise _error(path, f"reading it takes longer than {SECONDS / 60:.0f} minutes", OTHER) from error
    if done.returncode == REFUSED:
        told = json.loads(done.stdout)
        raise UserError(told["problem"], told["remedy"])
    if done.returncode < 0:
        raise _error(path, f"reading it ended with {signal.Signals(-done.returncode).name}", OTHER)
    if done.returncode:
        raise RuntimeError(f"reading {path} failed:\n{done.stderr}")


def main() -> None:
    """Carry out the order on standard input."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    order = json.loads(sys.stdin.read())
    try:
        _import(Path(order["root"]), Path(order["path"]), FilePart(**order["part"]))
    except UserError as error:
        sys.stdout.write(json.dumps({"problem": error.problem, "remedy": error.remedy}))
        raise SystemExit(REFUSED) from error


def _import(root: Path, path: Path, part: FilePart) -> None:
    try:
        reading = read(path, part.horizon)
        check(reading)
    except FileProblem as problem:
        raise _error(path, problem.cause, problem.remedy) from problem
    except MemoryError as error:
        raise _error(path, "it does not fit into memory", "Use a machine with more, or a part of the file.") from error
    except OSError as error:
        raise _error(path, error.strerror or str(error), "Name another file.") from error
    PartCache(root, part).write(0, reading.episodes)


def _error(path: Path, cause: str, remedy: str) -> UserError:
    return UserError(f"The data file {path} cannot be used: {cause}.", remedy)


if __name__ == "__main__":
    main()
