"""Records of a table with every kind of row that the highlight rule knows, under names that try to escape."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from helpers_records import make_record

from lfobench.record import Evaluation, Failure, Record, Warning

HOSTILE = "</script><img src=x onerror=alert(1)>"
QUOTED = 'o\'ril" onmouseover="alert(2)'
REVERSED = "גב\u202ecod.exe"

STARTS = 4

STEADY = np.array([[-1.0], [1.0], [0.5], [-0.5]]) + np.zeros((1, STARTS))


@pytest.fixture(scope="session")
def records() -> list[Record]:
    """Nine tasks, four methods: close, clear, tied for best, tied for second, untested, unopposed, and in between."""
    return list(_records())


@pytest.fixture(scope="session")
def failures() -> list[Failure]:
    """One seed of a cell with scores, and both seeds of a cell with none."""
    return [
        _failure(method, row, seed)
        for method, row, seed in (("dilo", "clear", 9), (QUOTED, "unopposed", 0), (QUOTED, "unopposed", 1))
    ]


def _records() -> Iterator[Record]:
    random = np.random.default_rng(7)
    for row, means in (
        ("close", {"dilo": 60.0, HOSTILE: 58.0, QUOTED: 20.0, "bc": 61.0}),
        ("clear", {"dilo": 90.0, HOSTILE: 40.0, QUOTED: 30.0, "bc": 20.0}),
        ("between", {"dilo": 70.0, HOSTILE: 55.0, QUOTED: 52.0, "bc": 72.0}),
        (REVERSED, {"dilo": 33.0, HOSTILE: 50.0, QUOTED: 20.0, "bc": 44.0}),
        ("unopposed", {"dilo": 50.0, "bc": 30.0}),
    ):
        for method, mean in means.items():
            yield from _cell(random.normal(mean, 6.0, (4, STARTS)), row, method)
    tied, lower = random.normal(50.0, 5.0, (4, STARTS)), random.normal(30.0, 5.0, (4, STARTS))
    for row, cells in (
        ("tied-best", {"dilo": tied, HOSTILE: tied[::-1], QUOTED: lower, "bc": lower}),
        ("tied-second", {"dilo": tied + 40.0, HOSTILE: tied, QUOTED: tied[::-1], "bc": lower}),
        # Two share second place, and only the one that varies is level with the best.
        ("spread", {"dilo": 60.0 + STEADY, HOSTILE: 50.0 + STEADY, QUOTED: 50.0 + 30.0 * STEADY, "bc": lower}),
        ("single", {"dilo": tied[:1], HOSTILE: lower[:1], "bc": lower[1:2]}),
    ):
        for method, scores in cells.items():
            yield from _cell(scores, row, method)


def _cell(scores: np.ndarray, row: str, method: str) -> Iterator[Record]:
    for seed, starts in enumerate(scores):
        # Halves are exact in binary, so that equal means are equal to the last bit in any order of the seeds.
        yield _record(np.round(starts * 2.0) / 2.0, row, method, seed)


def _record(starts: np.ndarray, row: str, method: str, seed: int) -> Record:
    record = make_record(
        0.0,
        method,
        seed,
        row=row,
        sees_expert_actions=method == "bc",
        diverged_at=500 if (row, method, seed) == ("close", QUOTED, 2) else None,
        fingerprints={"offline": "ab12"},
        warnings=[Warning(what=f"{HOSTILE} is odd.", remedy="Look at it.")] if (method, seed) == ("bc", 0) else [],
    )
    evaluations = [
        Evaluation(step=1000 * (index + 1), returns=list(starts * 10.0), lengths=[100] * STARTS) for index in range(2)
    ]
    provenance = record.provenance | {
        "packages": {"torch": "2.0", HOSTILE: "1"},
        "seconds": {"train": 100.0, "evaluate": 20.0},
        "device": {"type": "cpu", "name": HOSTILE, "precision": "float32"},
        "source_revision": "0123456789abcdef",
        "demonstration_score": 95.5,
    }
    return record.model_copy(update={"evaluations": evaluations, "provenance": provenance})


def _failure(method: str, row: str, seed: int) -> Failure:
    record = make_record(0.0, method, seed, row=row)
    return Failure(
        identity_hash=record.identity_hash,
        identity=record.identity,
        labels=record.labels,
        error=f"RuntimeError: {HOSTILE}",
        traceback=["Traceback", f"  {QUOTED}"],
    )
