"""Every pair runs, and its result is JSON."""

from __future__ import annotations

import json

import pytest
import torch

from benchmarks.pairs import Alternation, Spread, Timing
from benchmarks.training import Bench, Effort, SeedsTogether
from benchmarks.workloads import WORKLOADS

BENCH = Bench(torch.device("cpu"), Effort.of(quick=True))


@pytest.mark.parametrize("name", WORKLOADS)
def test_a_step_is_compared(name: str) -> None:
    found = json.loads(json.dumps(BENCH.step(WORKLOADS[name], 32).as_json()))
    assert [timing["name"] for timing in found["timings"]] == ["authors", "engine", "floor"]
    assert found["authors_over_engine"]["minimum"] > 0
    assert found["engine_over_floor"]["median"] > 0


def test_seeds_train_together() -> None:
    found = json.loads(json.dumps(BENCH.seeds(WORKLOADS["dilo"], 16, (1, 2)).as_json()))
    assert [entry["seeds"] for entry in found["seeds"]] == [1, 2]
    assert found["seeds"][0]["step_ratio"]["median"] == 1.0


def test_a_seed_step_is_a_step_over_its_seeds() -> None:
    timing = Alternation({"1": Timing("1", 1, (2.0, 2.0)), "4": Timing("4", 1, (4.0, 6.0))})
    found = SeedsTogether("dilo", "hopper", 16, (1, 4), timing)
    assert found.step_ratio(4) == Spread(2.0, 2.5, 3.0)
    assert found.seed_step_ratio(4) == Spread(0.5, 0.625, 0.75)
    assert found.as_json()["seeds"][1]["seconds_per_seed_step"]["median"] == 1.25


def test_every_workload_is_compared_at_its_released_batch() -> None:
    batches = {name: workload.released_batch for name, workload in WORKLOADS.items()}
    assert batches == {
        "dilo": 1024,
        "smodice": 512,
        "oril": 512,
        "bco": 1024,
        "bco inverse dynamics": 1024,
        "bc": 512,
    }
