"""Speed of results: intervals by bootstrap, and thousands of records read into a frame."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np

import lfobench
from benchmarks.built_task import CPU, cell_of
from benchmarks.pairs import Spread
from lfobench.cells.cell import Run
from lfobench.record import Evaluation, Metrics, Record
from lfobench.records.sealed import SEAL
from lfobench.stats.aggregates import REPLICATES, interquartile_mean
from lfobench.text import content_hash

METHODS, TASKS, SEEDS = 8, 24, 7
RECORDS, EVALUATIONS, EPISODES = 10_000, 20, 10


def bootstrap_seconds(quick: bool, rounds: int) -> Spread:
    """Interquartile means with intervals for a table of 8 methods, 24 tasks and 7 seeds, one thread."""
    scores = np.random.default_rng(0).normal(50.0, 20.0, (METHODS, SEEDS, TASKS))
    replicates = 100 if quick else REPLICATES
    interquartile_mean(scores[0], replicates=100)
    seconds = []
    for _ in range(rounds):
        started = time.perf_counter()
        for method in scores:
            interquartile_mean(method, replicates=replicates)
        seconds.append(time.perf_counter() - started)
    return Spread.of(seconds)


def record_seconds(quick: bool, rounds: int) -> dict[str, Any]:
    """`lfobench.load` of 10,000 records: the first time, when each is checked, and again."""
    count = 20 if quick else RECORDS
    with TemporaryDirectory(prefix="lfobench-bench-") as cache, TemporaryDirectory(prefix="lfobench-bench-") as folder:
        _write_records(Path(folder), count)
        with patch.dict(os.environ, LFOBENCH_CACHE=cache):
            started = time.perf_counter()
            first_frame = lfobench.load(folder)
            first = time.perf_counter() - started
            again = []
            for _ in range(rounds):
                started = time.perf_counter()
                frame = lfobench.load(folder)
                again.append(time.perf_counter() - started)
        if len(frame) != count * EVALUATIONS or not frame.equals(first_frame):
            raise RuntimeError("the second frame is not the first")
    return {"records": count, "first_seconds": first, "again": Spread.of(again).as_json()}


def _write_records(folder: Path, count: int) -> None:
    """Records as runs leave them, from random returns."""
    cell = cell_of("dilo", "quick", CPU)
    generator = np.random.default_rng(0)
    for seed in range(count):
        run = Run(cell, seed)
        returns = generator.normal(1000.0, 300.0, (EVALUATIONS, EPISODES)).tolist()
        steps = [1000 * (index + 1) for index in range(EVALUATIONS)]
        record = Record(
            identity_hash=run.identity_hash,
            identity=run.identity,
            labels=cell.labels,
            status="finished",
            diverged_at=None,
            evaluations=[
                Evaluation(step=step, returns=row, lengths=[1000] * EPISODES)
                for step, row in zip(steps, returns, strict=True)
            ],
            metrics=[Metrics(stage="policy", step=step, values={"loss": 0.5, "value": 1.5}) for step in steps],
            warnings=[],
            provenance={"seconds": {"train": 1.0, "evaluate": 1.0}},
        )
        content = record.model_dump(mode="json")
        path = folder / f"{seed}.json"
        path.write_text(json.dumps({**content, SEAL: content_hash(content)}, indent=1), encoding="utf-8")
