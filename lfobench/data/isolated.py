"""Isolated process that opens a file from outside and returns a shard or a diagnosis.

Such a file can make the HDF5 library loop, take all memory or crash; then only that process fails. It loads no plugin,
and it ends in one of three ways: the work is done, a problem is reported, or the process died.

Run as ``python -m lfobench.data.isolated``, with the order as JSON on standard input.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from lfobench.cells.parts import FilePart
from lfobench.data.cache import PartCache
from lfobench.data.doctor import Diagnosis, diagnose
from lfobench.data.readers.formats import read, sha256
from lfobench.data.readers.hdf5 import OTHER, FileProblem
from lfobench.data.readers.reading import Keys, check, with_columns
from lfobench.errors import UserError

REFUSED, FAILED = 3, 4
SECONDS = 1_800.0
"""Time limit for one file; a million transitions take seconds."""


class DataFileRefused(UserError):
    """Error whose cause lies in the file itself; another copy may work."""


def import_file(root: Path, path: Path, part: FilePart) -> None:
    """Make the shard of a file, whole or not at all; from then on the file is not opened again.

    Args:
        root: of the cache.
        path: the file.
        part: what it is.

    Raises:
        UserError: with the file, the cause and the remedy.
    """
    _carry_out(path, {"do": "import", "root": str(root), "path": str(path), "part": asdict(part)})


def examine_file(path: Path, horizon: int | None, keys: Keys = None) -> Diagnosis:
    """Diagnosis of a file, of whose observations `keys` are read.

    Raises:
        UserError: it cannot be read at all.
    """
    answer = _carry_out(path, {"do": "examine", "path": str(path), "horizon": horizon, "keys": keys})
    return TypeAdapter(Diagnosis).validate_json(answer)


def _carry_out(path: Path, order: dict[str, Any]) -> str:
    environment = {**os.environ, "HDF5_PLUGIN_PRELOAD": "::", "HDF5_USE_FILE_LOCKING": "FALSE"}
    try:
        done = subprocess.run(
            # -P: no module is taken from the working folder, which may be the file's own.
            [sys.executable, "-P", "-m", "lfobench.data.isolated"],
            input=json.dumps(order),
            capture_output=True,
            text=True,
            timeout=SECONDS,
            env=environment,
        )
    except subprocess.TimeoutExpired as error:
        raise _error(path, f"reading it takes longer than {SECONDS / 60:.0f} minutes", OTHER) from error
    if done.returncode in (REFUSED, FAILED):
        answer = json.loads(done.stdout)
        raise (DataFileRefused if done.returncode == REFUSED else UserError)(answer["problem"], answer["remedy"])
    if done.returncode < 0:
        raise _error(path, f"reading it ended with {signal.Signals(-done.returncode).name}", OTHER)
    if done.returncode:
        raise RuntimeError(f"reading {path} failed:\n{done.stderr}")
    return done.stdout


def main() -> None:
    """Carry out the order on standard input."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (_most_memory(), resource.RLIM_INFINITY))
    order = json.loads(sys.stdin.read())
    path = Path(order["path"])
    try:
        if order["do"] == "import":
            _import(Path(order["root"]), path, TypeAdapter(FilePart).validate_python(order["part"]))
        else:
            keys = None if order["keys"] is None else tuple(order["keys"])
            sys.stdout.write(json.dumps(asdict(_examine(path, order["horizon"], keys)), allow_nan=False))
    except UserError as error:
        sys.stdout.write(json.dumps({"problem": error.problem, "remedy": error.remedy}))
        raise SystemExit(REFUSED if isinstance(error, DataFileRefused) else FAILED) from error


def _most_memory() -> int:
    """Bytes of address space: three quarters of this machine's memory."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 4 * 3


def _import(root: Path, path: Path, part: FilePart) -> None:
    with _problems_as_user_errors(path):
        reading = read(path, part.horizon, part.keys)
        check(reading)
        episodes = with_columns(reading.episodes, part.columns)
        if sha256(path) != part.sha256:
            raise FileProblem("it changed since this command began", "Run the command again.")
    PartCache(root, part).write(0, episodes)


def _examine(path: Path, horizon: int | None, keys: Keys) -> Diagnosis:
    with _problems_as_user_errors(path):
        return diagnose(read(path, horizon, keys), horizon)


@contextmanager
def _problems_as_user_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except FileProblem as problem:
        raise _refused(path, problem) from problem
    except MemoryError as error:
        raise _error(path, "it does not fit into memory", "Use a machine with more, or a part of the file.") from error
    except OSError as error:
        raise _error(path, error.strerror or str(error), "Name another file.") from error


def _error(path: Path, cause: str, remedy: str) -> UserError:
    return UserError(f"The data file {path} cannot be used: {cause}.", remedy)


def _refused(path: Path, problem: FileProblem) -> DataFileRefused:
    return DataFileRefused(f"The data file {path} cannot be used: {problem.cause}.", problem.remedy)


if __name__ == "__main__":
    main()
