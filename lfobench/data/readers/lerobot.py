"""LeRobot's datasets, version 3: tables of frames in Parquet below ``data/``, described in ``meta/info.json``.

A frame has ``observation.state``, ``action``, ``episode_index``, ``frame_index``, and perhaps ``next.reward`` and
``next.done``. Other features of an observation are read where the user chooses them, but no video or image. The
observation after an episode's last action is not recorded, nor why the episode ended: ``next.done`` marks its last
frame. Parquet is read by pyarrow, which the extra ``lerobot`` installs.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import Episodes, IntArray
from lfobench.data.readers.arrays import MOST_INFLATION, Held
from lfobench.data.readers.hdf5 import AGAIN, OTHER, FileProblem, another, missing, short
from lfobench.data.readers.reading import Keys, Reading, as_float32, choose, differing_kinds, flags, row_numbers
from lfobench.text import counted, shown

INFO = Path("meta") / "info.json"
MOST_INFO = 2**22
"""Bytes of the description, at the most."""
TABLES = "data/*/*.parquet"
OBSERVATION, STATE, ACTION, REWARD, DONE = "observation.", "observation.state", "action", "next.reward", "next.done"
EPISODE, FRAME = "episode_index", "frame_index"
BATCH = 2**20
"""Numbers unpacked at once, or one row where that has more."""


def is_lerobot(folder: Path) -> bool:
    """True if a folder is such a dataset."""
    return (folder / INFO).is_file()


def files_of(folder: Path) -> list[Path]:
    """Files of a dataset that are read: its description, and its tables in the order of LeRobot's own reader.

    Raises:
        FileProblem: there is no table.
    """
    tables = sorted(path for path in folder.glob(TABLES) if path.is_file())
    if not tables:
        raise FileProblem(f"it is a LeRobot dataset without {TABLES}", AGAIN)
    return [folder / INFO, *tables]


def read(folder: Path, keys: Keys = None) -> Reading:
    """Every episode, by number, its observations made of `keys`.

    Raises:
        FileProblem: naming the file or the field.
        OSError: a file cannot be read.
    """
    info, (_, *tables) = _information(folder), files_of(folder)
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise FileProblem(
            "it is a LeRobot dataset, whose tables pyarrow reads, which is not installed",
            "Install it: pip install 'lfobench[lerobot]'.",
        ) from error
    chosen = keys or (STATE,)
    parts = [_Table(path, folder, chosen) for path in tables]
    there = list(dict.fromkeys(name for part in parts for name in part.there))
    columns = {name: _end_to_end([part.columns[name] for part in parts]) for name in (*chosen, ACTION, EPISODE, FRAME)}
    rewarded = sum(REWARD in part.columns for part in parts)
    rewards = [part.columns[REWARD] for part in parts] if rewarded == len(parts) else []
    lengths = _lengths(*(columns[name][:, 0].astype(np.int64) for name in (EPISODE, FRAME)))
    rows, last = int(lengths.sum()), np.cumsum(lengths) - 1
    observations = as_float32(np.hstack([columns[key] for key in chosen]))
    stacked = np.full((rows + len(lengths), observations.shape[1]), np.nan, np.float32)
    stacked[row_numbers(lengths)] = observations
    ended = [part.columns[DONE] for part in parts if DONE in part.columns]
    done = flags(Held(DONE, _end_to_end(ended)[:, 0])) if len(ended) == len(parts) else None
    within = np.zeros(rows, np.bool_) if done is None else done.copy()
    within[last] = False
    declared = [info.get(name) for name in ("total_episodes", "total_frames")]
    known = (*chosen, ACTION, REWARD, DONE, EPISODE, FRAME)
    return Reading(
        Episodes(
            stacked,
            as_float32(columns[ACTION]),
            as_float32(_end_to_end(rewards)[:, 0]) if rewards else np.full(rows, np.nan, np.float32),
            lengths,
            np.zeros(len(lengths), np.bool_),
        ),
        "lerobot",
        keys={key: columns[key].shape[1] for key in chosen},
        left_out=_left_out(info, there, chosen),
        chosen=keys is not None,
        not_read=tuple(shown(name) for name in there if name not in known and not name.startswith(OBSERVATION)),
        rewards=bool(rewards),
        rewardless=len(parts) - rewarded if rewarded else 0,
        timeouts=False,
        ends_known=False,
        endless=np.zeros(0, np.int64) if done is None else np.flatnonzero(~done[last]),
        ended_within=np.flatnonzero(within),
        kinds=differing_kinds({name: [part.held(name) for part in parts] for name in (*chosen, ACTION)}),
        declared_episodes=declared[0] if type(declared[0]) is int else None,
        declared_steps=declared[1] if type(declared[1]) is int else None,
    )


def _information(folder: Path) -> dict[str, Any]:
    with (folder / INFO).open("rb") as file:
        content = file.read(MOST_INFO + 1)
    try:
        info = json.loads(content) if len(content) <= MOST_INFO else None
    except (ValueError, RecursionError) as error:
        raise FileProblem(f"its {INFO} is no JSON ({short(error)})", AGAIN) from error
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if not isinstance(info, dict) or not isinstance(version, str):
        raise FileProblem(f"its {INFO} does not say which version of LeRobot's datasets it is", AGAIN)
    if not version.startswith("v3."):
        raise FileProblem(
            f"it is a LeRobot dataset of version {shown(version)}, and only version 3 is read",
            "Convert it: LeRobot's own script convert_dataset_v21_to_v30 does.",
        )
    return info


def _left_out(info: dict[str, Any], there: Sequence[str], chosen: Sequence[str]) -> dict[str, int]:
    """Features of an observation that are not read, with their numbers of columns; 0 for one that is no vector."""
    features = info.get("features")
    described = features if isinstance(features, dict) else {}
    found = {}
    for name in dict.fromkeys((*there, *described)):
        if name.startswith(OBSERVATION) and name not in chosen:
            feature = described.get(name)
            shape = feature.get("shape") if isinstance(feature, dict) else None
            found[name] = 0
            if isinstance(shape, list) and len(shape) == 1 and type(shape[0]) is int:
                found[name] = shape[0]
    return found


def _lengths(episode: IntArray, frame: IntArray) -> IntArray:
    """Frames of every episode ``[E]``.

    Raises:
        FileProblem: an episode is in pieces, out of order, or lacks a frame.
    """
    begins = np.concatenate(([0], np.flatnonzero(np.diff(episode)) + 1))
    if (back := np.flatnonzero(np.diff(episode[begins]) <= 0)).size:
        row = int(begins[back[0] + 1])
        raise FileProblem(f"episode {int(episode[row]):,} begins in row {row:,}, after a later one", OTHER)
    lengths = np.diff(np.append(begins, len(episode)))
    expected = np.arange(len(episode)) - np.repeat(begins, lengths)
    if (wrong := np.flatnonzero(frame != expected)).size:
        row = int(wrong[0])
        raise FileProblem(
            f"frame {int(expected[row]):,} of episode {int(episode[row]):,} is missing: row {row:,} has {FRAME} "
            f"{int(frame[row]):,}",
            OTHER,
        )
    return lengths.astype(np.int64)


class _Table:
    """One table, read.

    Attributes:
        there: names of its columns.
        columns: ``[n, width]`` of each that is read.
    """

    def __init__(self, path: Path, folder: Path, keys: Sequence[str]) -> None:
        import pyarrow.parquet as parquet

        self._name = str(path.relative_to(folder))
        with _damage_as_problem(self._name), parquet.ParquetFile(path) as file:
            self.there = list(file.schema_arrow.names)
            for name in (*keys, ACTION, EPISODE, FRAME):
                if name not in self.there:
                    raise missing(f"{self._name}/{name}", self.there, choose if name in keys else another)
            wanted = [*keys, ACTION, EPISODE, FRAME, *(name for name in (REWARD, DONE) if name in self.there)]
            for name in wanted:
                _check_kind(file.schema_arrow.field(name).type, f"{self._name}/{name}")
            rows, size = file.metadata.num_rows, path.stat().st_size
            numbers, unpacked = _numbers(file, wanted), 0
            if 4 * numbers > MOST_INFLATION * size:
                raise FileProblem(
                    f"'{self._name}' declares {counted(rows, 'row')} of {numbers:,} numbers and has {size:,} bytes",
                    AGAIN,
                )
            if not rows:
                raise FileProblem(f"'{self._name}' has no row", OTHER)
            parts: dict[str, list[NDArray[Any]]] = {name: [] for name in wanted}
            for batch in file.iter_batches(max(1, BATCH * rows // numbers), columns=wanted):
                if (unpacked := unpacked + batch.nbytes) > MOST_INFLATION * size:
                    raise FileProblem(
                        f"'{self._name}' unpacks to more than {MOST_INFLATION:,} times its {size:,} bytes", AGAIN
                    )
                for name in wanted:
                    parts[name].append(_vectors(batch.column(name), f"{self._name}/{name}"))
            self.columns = {name: _end_to_end(values) for name, values in parts.items()}
        for name in (EPISODE, FRAME):
            if self.columns[name].dtype.kind not in "iu":
                raise FileProblem(f"field '{self._name}/{name}' holds no whole numbers", OTHER)

    def held(self, name: str) -> Held:
        """A column that was read."""
        return Held(f"{self._name}/{name}", self.columns[name])


def _numbers(file: Any, wanted: Sequence[str]) -> int:
    """Numbers in the columns of a file: the greater of the counts by type and by stored values."""
    rows = file.metadata.num_rows
    kinds = [file.schema_arrow.field(name).type for name in wanted]
    typed = sum(rows * getattr(kind, "list_size", 1) for kind in kinds)
    groups = [file.metadata.row_group(index) for index in range(file.metadata.num_row_groups)]
    chunks = [group.column(index) for group in groups for index in range(group.num_columns)]
    below = tuple(f"{name}." for name in wanted)  # as "action.list.element"
    stored = [
        chunk.num_values for chunk in chunks if chunk.path_in_schema in wanted or chunk.path_in_schema.startswith(below)
    ]
    return int(max(typed, sum(stored)))


def _is_list(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def _check_kind(kind: Any, field: str) -> None:
    """Refusal of a column that holds neither numbers nor lists of them, before any of it is read."""
    from pyarrow import types

    plain = kind.value_type if _is_list(kind) else kind
    if not (types.is_floating(plain) or types.is_integer(plain) or types.is_boolean(plain)):
        raise FileProblem(f"field '{field}' holds {shown(str(kind))}, not plain numbers", OTHER)


def _vectors(column: Any, field: str) -> NDArray[Any]:
    """Rows of a column of numbers, or of lists of them ``[n, width]``.

    Raises:
        FileProblem: not all of a row is there.
    """
    import pyarrow.compute as compute

    listed = _is_list(column.type)
    numbers = column.flatten() if listed else column
    if column.null_count or numbers.null_count:
        raise FileProblem(f"field '{field}' has a row without a value", OTHER)
    values: NDArray[Any] = numbers.to_numpy(zero_copy_only=False)
    if not listed:
        return values[:, None]
    widths = compute.list_value_length(column).to_numpy(zero_copy_only=False)
    if not widths[0] or (widths != widths[0]).any():
        raise FileProblem(f"field '{field}' has rows of different length", OTHER)
    return values.reshape(len(widths), int(widths[0]))


def _end_to_end(parts: Iterable[NDArray[Any]]) -> NDArray[Any]:
    """Rows of one column."""
    arrays = list(parts)
    widths = sorted({array.shape[1] for array in arrays})
    if len(widths) > 1:
        raise FileProblem(f"a column has {widths[0]} numbers in some rows and {widths[-1]} in others", OTHER)
    return np.concatenate(arrays)


@contextmanager
def _damage_as_problem(name: str) -> Iterator[None]:
    import pyarrow

    try:
        yield
    except MemoryError:
        raise
    except (pyarrow.ArrowException, ValueError, OverflowError, KeyError, TypeError, OSError) as error:
        raise FileProblem(f"'{name}' is damaged ({short(error)})", AGAIN) from error
