"""Records as a data frame, for notebooks and anybody's own analysis."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lfobench.contract.record import Record, Warning
from lfobench.store.folder import RecordFolder, read_record, warnings_of_copies
from lfobench.store.index import Digest, Stamp, digest, read_index, write_index

RUN_COLUMNS = (
    "suite",
    "group",
    "row",
    "task",
    "method",
    "method_version",
    "preset",
    "set",
    "source",
    "protocol",
    "protocol_steps",
    "environment",
    "precision",
    "seed",
    "status",
)


def load(path: str | Path, *, episodes: bool = False, fresh: bool = False) -> pd.DataFrame:
    """The records below a folder as a tidy frame: one row per run and evaluation, or per episode.

    Columns: those of `RUN_COLUMNS`, which say what was run; then, per evaluation, ``step`` (gradient steps), ``score``
    (mean normalised score of its episodes), ``return`` and ``length`` (means), ``episodes`` (their number); or, per
    episode, ``step``, ``episode``, ``score``, ``return``, ``length``; and ``identity``, the hash that names the run.

    A run that diverged before its first evaluation has one row, at the step where it diverged, whose score is missing
    (and whose presence makes columns of whole numbers columns of floats).

    Records are verified when they are first read. A file of unchanged size and modification time is not opened again;
    `fresh` verifies all of them anew.

    Example::

        frame = lfobench.load("runs")
        frame.groupby(["task", "method", "step"])["score"].mean()

    Raises:
        UserError: no such folder.
    """
    root = Path(path)
    digests, problems = _read(root, fresh)
    for problem in problems:
        warnings.warn(f"{problem.what} {problem.remedy}", stacklevel=2)
    return _episodes(digests) if episodes else _evaluations(digests)


def _read(root: Path, fresh: bool) -> tuple[list[Digest], list[Warning]]:
    """Digests of one record per run, as `RecordFolder.read_all` chooses them, and its warnings."""
    known = {} if fresh else read_index(root)
    current: dict[str, Digest] = {}
    problems: list[Warning] = []
    by_run: dict[str, list[tuple[Path, Digest]]] = {}
    for file in RecordFolder(root).files():
        name = str(file.relative_to(root))
        each = _digest(file, known.get(name))
        if isinstance(each, Digest):
            current[name] = each
            by_run.setdefault(each.identity_hash, []).append((file, each))
        else:
            problems.append(each)
    if current.keys() != known.keys() or any(current[name] is not known[name] for name in current):
        write_index(root, current)
    chosen = []
    for copies in by_run.values():
        contradict = any(each.outcome_hash != copies[0][1].outcome_hash for _, each in copies)
        problems += warnings_of_copies([file for file, _ in copies], contradict)
        if not contradict:
            chosen.append(copies[0][1])
    return chosen, problems


def _digest(file: Path, known: Digest | None) -> Digest | Warning:
    try:
        # Taken before reading: a file that changes meanwhile has another stamp the next time.
        stamp = Stamp.of(file)
    except OSError:
        stamp = Stamp(-1, -1)
    if known is not None and known.stamp == stamp:
        return known
    record = read_record(file)
    return digest(record, stamp) if isinstance(record, Record) else record


def _evaluations(digests: Sequence[Digest]) -> pd.DataFrame:
    counts = _lengths([each.steps for each in digests])
    episodes = _joined([each.episodes for each in digests], np.int64)
    starts = np.cumsum(episodes) - episodes
    returns, lengths = (
        _joined([each.returns for each in digests], np.float64),
        _joined([each.lengths for each in digests], np.float64),
    )
    means = np.add.reduceat(returns, starts) / episodes if len(starts) else returns
    frame = _runs(digests, counts)
    frame["step"] = _joined([each.steps for each in digests], np.int64)
    frame["score"] = _scores(digests, counts, means)
    frame["return"] = means
    frame["length"] = np.add.reduceat(lengths, starts) / episodes if len(starts) else lengths
    frame["episodes"] = episodes
    frame["identity"] = _repeated([each.identity_hash for each in digests], counts)
    return _with_unevaluated(frame, digests)


def _episodes(digests: Sequence[Digest]) -> pd.DataFrame:
    counts = _lengths([each.returns for each in digests])
    per_evaluation = _joined([each.episodes for each in digests], np.int64)
    returns = _joined([each.returns for each in digests], np.float64)
    starts = np.cumsum(per_evaluation) - per_evaluation
    frame = _runs(digests, counts)
    frame["step"] = np.repeat(_joined([each.steps for each in digests], np.int64), per_evaluation)
    frame["episode"] = np.arange(len(returns)) - np.repeat(starts, per_evaluation)
    frame["score"] = _scores(digests, counts, returns)
    frame["return"] = returns
    frame["length"] = _joined([each.lengths for each in digests], np.int64)
    frame["identity"] = _repeated([each.identity_hash for each in digests], counts)
    return _with_unevaluated(frame, digests)


def _runs(digests: Sequence[Digest], counts: NDArray[np.int64]) -> pd.DataFrame:
    return pd.DataFrame({name: _repeated([each.fields[name] for each in digests], counts) for name in RUN_COLUMNS})


def _scores(digests: Sequence[Digest], counts: NDArray[np.int64], returns: NDArray[np.float64]) -> NDArray[np.float64]:
    low = np.repeat(np.array([each.fields["random_return"] for each in digests], np.float64), counts)
    high = np.repeat(np.array([each.fields["expert_return"] for each in digests], np.float64), counts)
    return np.asarray(100.0 * (returns - low) / (high - low))


def _with_unevaluated(frame: pd.DataFrame, digests: Sequence[Digest]) -> pd.DataFrame:
    rows = [
        {name: each.fields[name] for name in RUN_COLUMNS}
        | {"step": each.fields["diverged_at"], "identity": each.identity_hash}
        for each in digests
        if not len(each.steps)
    ]
    return pd.concat([frame, pd.DataFrame(rows, columns=frame.columns)], ignore_index=True) if rows else frame


def _repeated(values: Sequence[Any], counts: NDArray[np.int64]) -> pd.api.extensions.ExtensionArray:
    """One value per run, for as many rows as the run has; text as text, without a copy of it per row."""
    series = pd.Series(list(values))
    return series.take(np.repeat(np.arange(len(series)), counts)).array


def _lengths(parts: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    return np.array([len(part) for part in parts], dtype=np.int64)


def _joined(parts: Sequence[NDArray[Any]], kind: type[np.int64] | type[np.float64]) -> NDArray[Any]:
    return np.asarray(np.concatenate([np.empty(0, kind), *parts]), dtype=kind)
