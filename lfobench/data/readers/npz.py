"""NPZ archives of NumPy: D4RL's flat arrays in one archive, or a folder with an archive per episode.

The names are D4RL's, or those of other tools (`NAMES`). An archive with one more observation than actions is
one episode. In a folder, whose archives are read by the numbers in their names, the last row of each ends an episode,
flagged or not. Nothing is unpickled, and nothing is unpacked that is out of proportion to its archive.
"""

from __future__ import annotations

import math
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfobench.data.readers.arrays import MOST_INFLATION, Held, check_plain
from lfobench.data.readers.d4rl import DIMENSIONS, flat
from lfobench.data.readers.hdf5 import AGAIN, OTHER, FileProblem, missing, short
from lfobench.data.readers.reading import Reading, differing_kinds, same_columns, same_rows
from lfobench.text import shown

SUFFIX = ".npz"
NAMES = {
    "observations": ("observations", "observation", "obs"),
    "actions": ("actions", "action", "acts"),
    "terminals": ("terminals", "terminal", "terminations", "terminated"),
    "timeouts": ("timeouts", "timeout", "truncations", "truncated"),
    "rewards": ("rewards", "reward", "rews"),
    "next_observations": ("next_observations", "next_observation", "next_obs"),
}
FLAGS = ("terminals", "timeouts")
MOST_HEADER = 4096
"""Bytes of an array's header, at the most; that of a plain array has 128."""
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
DAMAGE = (
    OSError,
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    ValueError,
    RuntimeError,
    NotImplementedError,
    OverflowError,
    KeyError,
    TypeError,
    SyntaxError,
)
"""Errors of ``zipfile`` and NumPy over damaged bytes."""


def archives(folder: Path) -> list[Path]:
    """The archives directly in a folder, by the numbers in their names, then by name.

    Raises:
        OSError: the folder cannot be listed.
    """
    found = [path for path in folder.iterdir() if path.suffix == SUFFIX and path.is_file()]
    return sorted(
        found, key=lambda path: ([int(number) for number in re.findall("[0-9]+", path.stem[:100])], path.name)
    )


def read(files: Sequence[Path], horizon: int | None = None, in_folder: bool = False) -> Reading:
    """The episodes of archives.

    Args:
        files: at least one.
        horizon: as for D4RL's layout, where one file has no time-outs.
        in_folder: whether the last row of each ends an episode.

    Raises:
        FileProblem: naming the archive's field.
        OSError: an archive cannot be read.
    """
    parts, not_read = [], []
    whole = False
    for file in files:
        fields, others = _fields(file, f"{shown(file.name)}/" if in_folder else "")
        not_read += others
        for name in ("observations", "actions"):
            if name not in fields:
                raise missing(_field_name(file, name, in_folder), [*(each.field for each in fields.values()), *others])
        if one := fields["observations"].rows == fields["actions"].rows + 1:
            fields = _stepwise(fields)
        elif not in_folder and "terminals" not in fields:
            raise missing("terminals", [*(each.field for each in fields.values()), *others])
        if not fields["actions"].rows:
            raise FileProblem(f"field '{fields['actions'].field}' has no row", OTHER)
        same_rows(fields.values(), fields["actions"].rows, f"'{fields['actions'].field}'")
        whole = whole or one
        parts.append(fields)
    return _joined(parts, horizon, in_folder or whole, tuple(dict.fromkeys(not_read)))


def _joined(parts: list[dict[str, Held]], horizon: int | None, ends_known: bool, not_read: tuple[str, ...]) -> Reading:
    """Episodes of archives, each of which is checked already."""
    ends = np.concatenate([np.arange(each["actions"].rows) == each["actions"].rows - 1 for each in parts])
    joined = {}
    rewardless = 0
    for name in DIMENSIONS:
        have = [each for each in parts if name in each]
        if not have:
            continue
        if len(have) < len(parts):
            lacks = next(each for each in parts if name not in each)
            if name == "rewards":
                rewardless = len(parts) - len(have)
                continue
            if name not in FLAGS:
                raise FileProblem(
                    f"'{have[0][name].field}' is there, and no {name} next to '{lacks['actions'].field}'", OTHER
                )
        first = have[0][name]
        for each in have:
            if DIMENSIONS[name] == 2:
                same_columns(each[name], first.shape[1], f"'{first.field}'")
        arrays = [each[name].values if name in each else np.zeros(each["actions"].rows, np.bool_) for each in parts]
        joined[name] = Held(first.field if len(parts) == 1 else name, np.concatenate(arrays))
    reading = flat(joined, "npz", horizon, ends if ends_known else None, not_read)
    kinds = {name: [each[name] for each in parts if name in each] for name in ("observations", "actions")}
    return replace(reading, rewardless=rewardless, kinds={**reading.kinds, **differing_kinds(kinds)})


def _stepwise(fields: dict[str, Held]) -> dict[str, Held]:
    """An episode of T + 1 observations as T rows, each with the observation that it leads to."""
    observations = fields["observations"]
    if "next_observations" in fields:
        raise FileProblem(
            f"field '{observations.field}' has one row more than '{fields['actions'].field}', so that "
            f"'{fields['next_observations'].field}' has none to add",
            OTHER,
        )
    return {
        **fields,
        "observations": Held(observations.field, observations.values[:-1]),
        "next_observations": Held(observations.field, observations.values[1:]),
    }


def _fields(file: Path, prefix: str) -> tuple[dict[str, Held], list[str]]:
    """Arrays of an archive by D4RL's names, and the names of its other members."""
    with _damage_as_problem(prefix), zipfile.ZipFile(file) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        size = file.stat().st_size
        wanted = {}
        for field, spellings in NAMES.items():
            there = [name for name in spellings if name in members]
            if len(there) > 1:
                raise FileProblem(f"fields '{prefix}{there[0]}' and '{prefix}{there[1]}' mean the same", OTHER)
            if there:
                wanted[field] = there[0]
        unpacked = sum(members[name].file_size for name in wanted.values())
        if unpacked > MOST_INFLATION * size:
            raise FileProblem(f"it declares {unpacked:,} bytes of arrays, and has {size:,}", AGAIN)
        fields = {
            field: Held(prefix + name, _array(archive, members[name], prefix + name, DIMENSIONS[field]))
            for field, name in wanted.items()
        }
        return fields, [shown(prefix + name) for name in members if name not in wanted.values()]


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, field: str, dimensions: int) -> NDArray[Any]:
    if member.compress_type not in METHODS:
        raise FileProblem(f"field '{field}' is compressed as NumPy does not", "Save it with numpy.savez.")
    with archive.open(member) as file:
        numpy_format: Any = np.lib.format
        version = numpy_format.read_magic(file)
        if version not in ((1, 0), (2, 0)):
            raise FileProblem(
                f"field '{field}' has version {version} of NumPy's format, which plain arrays do not", OTHER
            )
        header = numpy_format.read_array_header_1_0 if version == (1, 0) else numpy_format.read_array_header_2_0
        shape, by_column, kind = header(file, max_header_size=MOST_HEADER)
        if len(shape) == 2 and dimensions == 1 and shape[1] == 1:
            shape = shape[:1]
        check_plain(field, kind, shape, dimensions)
        expected = math.prod(shape) * kind.itemsize
        if min(shape) < 0 or expected > member.file_size:
            raise FileProblem(
                f"field '{field}' declares {expected:,} bytes {shape} and has {member.file_size:,}", AGAIN
            )
        content = file.read(expected)
        if len(content) != expected or file.read(1):
            raise FileProblem(f"field '{field}' has another number of bytes than {shape} of {kind.name} take", AGAIN)
    values = np.frombuffer(content, np.uint8 if kind.kind == "b" else kind)
    values = values.reshape(shape[::-1]).T if by_column else values.reshape(shape)
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def _field_name(file: Path, name: str, in_folder: bool) -> str:
    return f"{file.name}/{name}" if in_folder else name


@contextmanager
def _damage_as_problem(prefix: str) -> Iterator[None]:
    try:
        yield
    except DAMAGE as error:
        where = f"'{prefix.rstrip('/')}'" if prefix else "it"
        raise FileProblem(f"{where} is damaged or no archive of NumPy ({short(error)})", AGAIN) from error
