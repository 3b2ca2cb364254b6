"""Records as a data frame, for notebooks and custom analyses."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import ValidationError

from lfobench.errors import UserError
from lfobench.record import Record, Warning, first_problem
from lfobench.records.folder import RecordFolder, is_trial, read_record, warning_of_trial, warnings_of_copies
from lfobench.records.index import Digest, RunFields, Stamp, digest, joined, read_index, run_fields, write_index
from lfobench.text import harmless

RUN_COLUMNS = tuple(name for name in RunFields.model_fields if name not in ("random_return", "expert_return"))


def load(path: str | Path, *, episodes: bool = False, metrics: bool = False, fresh: bool = False) -> pd.DataFrame:
    """The records below a folder as a tidy frame: one row per run and evaluation, or per episode, or of metrics.

    Columns: those of `RUN_COLUMNS`, which describe the run; then, per evaluation, ``step`` (gradient steps), ``score``
    (mean normalised score of its episodes), ``return`` and ``length`` (means), ``episodes`` (their number); or, per
    episode, ``step``, ``episode``, ``score``, ``return``, ``length``; and ``identity``, the hash that names the run.
    Episodes from further starts are no evaluation and have no row; the score ``success`` of a table counts them.
    Text is plain text and not categorical, so that grouping gives the present groups only.

    With `metrics`, one row per run, training ``stage`` and ``step`` (updates of that stage done) at which metrics were
    logged, and one column per metric, which is the mean over the updates since the stage's previous row; NaN
    where the method has no such metric or the mean was not finite. A metric of the name of another column has
    ``metric_`` before its own. There is no column of scores: join the frame of evaluations on ``identity``.

    A run that diverged has status ``diverged`` and the evaluations before that. One that diverged before its first
    evaluation has one row, at the step where it diverged, without a score; ``episodes`` is 0. In a frame of episodes
    such a row lacks ``episode`` and ``length`` too, which are then columns of floats. A run with an episode's score
    beyond ±1e15 counts as diverged there; a warning names it.

    Names are as the records have them: a frame's own ``to_csv`` escapes neither control characters nor cells that begin
    like a formula, as ``lfobench table --format csv`` does.

    Records are verified when they are first read. A file with the same size and times of modification and of change is
    not opened again. An edit that restores all three (which takes setting the system's clock, or writing to the disk
    past the file system) is found only with `fresh`, which verifies every file anew.

    Example::

        frame = lfobench.load("runs")
        frame.groupby(["task", "method", "step"])["score"].mean()

    Raises:
        UserError: no such folder, or both episodes and metrics are requested.
    """
    if episodes and metrics:
        raise UserError("Rows of one frame are episodes or metrics, not both.", "Load two frames.")
    root = Path(path)
    if metrics:
        read = RecordFolder(root).read_all()
        frame, problems = _metrics(read.records), read.warnings
    else:
        digests, problems = _read(root, fresh)
        frame = _episodes(digests) if episodes else _evaluations(digests)
    for problem in problems:
        warnings.warn(harmless(f"{problem.what} {problem.remedy}"), stacklevel=2)
    return frame


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
            if each.stamp.settled:
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
            problems += [each for each in [chosen[-1].bound_warning] if each is not None]
    return chosen, problems


def _digest(file: Path, known: Digest | None) -> Digest | Warning:
    try:
        # Taken before reading: a file that changes meanwhile has another stamp the next time.
        stamp = Stamp.of(file)
    except OSError as error:
        return Warning(what=f"{file} was skipped: {error.strerror}.", remedy="Move it away.")
    if known is not None and known.stamp == stamp:
        return known
    record = read_record(file)
    if not isinstance(record, Record):
        return record
    if is_trial(record):
        return warning_of_trial(file)
    try:
        return digest(record, stamp)
    except ValueError as error:
        cause = first_problem(error) if isinstance(error, ValidationError) else str(error)
        return Warning(what=f"{file} is no record that a run leaves and was skipped ({cause}).", remedy="Move it away.")


def _evaluations(digests: Sequence[Digest]) -> pd.DataFrame:
    counts = _counts([each.steps for each in digests])
    episodes = joined([each.episodes for each in digests], np.int64)
    means, lengths = (
        _means(joined([getattr(each, name) for each in digests], np.float64), episodes)
        for name in ("returns", "lengths")
    )
    frame = _runs([each.fields for each in digests], counts)
    frame["step"] = joined([each.steps for each in digests], np.int64)
    frame["score"] = _scores(digests, counts, means)
    frame["return"] = means
    frame["length"] = lengths
    frame["episodes"] = episodes
    frame["identity"] = _repeated([each.identity_hash for each in digests], counts)
    return frame


def _episodes(digests: Sequence[Digest]) -> pd.DataFrame:
    episodes = joined([each.episodes for each in digests], np.int64)
    rows = np.maximum(episodes, 1)
    starts = np.cumsum(rows) - rows
    evaluated = np.repeat(episodes > 0, rows)
    counts = np.array([np.maximum(each.episodes, 1).sum() for each in digests], np.int64)
    returns = _where(evaluated, joined([each.returns for each in digests], np.float64))
    frame = _runs([each.fields for each in digests], counts)
    frame["step"] = np.repeat(joined([each.steps for each in digests], np.int64), rows)
    frame["episode"] = _where(evaluated, (np.arange(len(evaluated)) - np.repeat(starts, rows))[evaluated])
    frame["score"] = _scores(digests, counts, returns)
    frame["return"] = returns
    frame["length"] = _where(evaluated, joined([each.lengths for each in digests], np.int64))
    frame["identity"] = _repeated([each.identity_hash for each in digests], counts)
    return frame


def _metrics(records: Sequence[Record]) -> pd.DataFrame:
    counts = np.array([len(record.metrics) for record in records], np.int64)
    rows = [row for record in records for row in record.metrics]
    frame = _runs([run_fields(record) for record in records], counts)
    frame["stage"] = _repeated([row.stage for row in rows], np.ones(len(rows), np.int64))
    frame["step"] = np.array([row.step for row in rows], np.int64)
    fixed = {*frame.columns, "identity"}
    names = dict.fromkeys(name for row in rows for name in row.values)
    values = {
        f"metric_{name}" if name in fixed else name: np.array([row.values.get(name) for row in rows], np.float64)
        for name in names
    }
    identity = _repeated([record.identity_hash for record in records], counts)
    # All at once: a frame that grows by a hundred columns is copied as often.
    return pd.concat([frame, pd.DataFrame({**values, "identity": identity})], axis=1)


def _runs(runs: Sequence[RunFields], counts: NDArray[np.int64]) -> pd.DataFrame:
    return pd.DataFrame({name: _repeated([getattr(each, name) for each in runs], counts) for name in RUN_COLUMNS})


def _means(values: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean of every stretch of `counts` values; NaN of none."""
    sums = np.bincount(np.repeat(np.arange(len(counts)), counts), weights=values, minlength=len(counts))
    with np.errstate(invalid="ignore"):
        return np.asarray(sums / counts)


def _scores(digests: Sequence[Digest], counts: NDArray[np.int64], returns: NDArray[np.float64]) -> NDArray[np.float64]:
    low = np.repeat(np.array([each.fields.random_return for each in digests], np.float64), counts)
    high = np.repeat(np.array([each.fields.expert_return for each in digests], np.float64), counts)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(100.0 * (returns - low) / (high - low))


def _where(present: NDArray[np.bool_], values: NDArray[Any]) -> NDArray[Any]:
    """The values, in order, where they are present; as they are if all of them are, else as floats, NaN elsewhere."""
    if present.all():
        return values
    spread = np.full(len(present), np.nan)
    spread[present] = values
    return spread


def _repeated(values: Sequence[Any], counts: NDArray[np.int64]) -> pd.api.extensions.ExtensionArray:
    """One value per run, for as many rows as the run has; text as text, without a copy of it per row."""
    series = pd.Series(list(values))
    return series.take(np.repeat(np.arange(len(series)), counts)).array


def _counts(parts: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    return np.array([len(part) for part in parts], dtype=np.int64)
