"""Records as a data frame, for notebooks and anybody's own analysis."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd

from lfobench.contract.record import Record

COLUMNS = (
    "suite",
    "task",
    "method",
    "preset",
    "source",
    "protocol",
    "seed",
    "status",
    "step",
    "episode",
    "episode_return",
    "episode_length",
    "normalized_score",
    "identity",
)


def episodes_frame(records: Iterable[Record]) -> pd.DataFrame:
    """One row per evaluation episode, in record order; columns are `COLUMNS`.

    Example::

        frame = episodes_frame(RecordFolder(Path("runs")).read_all().records)
        frame.groupby(["task", "method", "step"])["normalized_score"].mean()
    """
    rows = [
        (
            record.labels.suite,
            record.task,
            record.method,
            record.identity["preset"],
            record.identity["source"],
            record.identity["protocol"]["name"],
            record.seed,
            record.status,
            evaluation.step,
            episode,
            episode_return,
            length,
            record.normalized_score(episode_return),
            record.identity_hash,
        )
        for record in records
        for evaluation in record.evaluations
        for episode, (episode_return, length) in enumerate(zip(evaluation.returns, evaluation.lengths, strict=True))
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))
