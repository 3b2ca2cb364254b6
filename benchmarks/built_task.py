"""A task of the paper's size on disk, filled with random numbers, on which loading and one whole cell are timed.

The files are what `lfobench data build` writes, checksums included; only their numbers come from a generator instead of
a simulator. So the benchmark needs no data of anybody's and takes seconds to set up.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch

from benchmarks.pairs import Contender, Spread, alternate
from lfobench.cells.cell import Assigned, Cell
from lfobench.cells.parts import SHARD_TRANSITIONS, requests
from lfobench.cells.plan import Request, make_plan
from lfobench.contract.episodes import Episodes
from lfobench.contract.suite import Task
from lfobench.data.cache import PartCache
from lfobench.data.firewall import view
from lfobench.data.source import load_task
from lfobench.engine.job import Job, run_job
from lfobench.records.folder import RecordFolder
from lfobench.registry import load_suite

CPU = torch.device("cpu")
SUITE, TASK = "locomotion", "hopper-random-expert"
OBSERVATION, ACTION = 11, 3
# Lengths of falling and of lasting episodes, as random and expert hoppers have them.
LENGTHS = {"random": 25, "medium": 500, "expert": 1000}


@contextmanager
def built_task(cell: Cell) -> Iterator[Path]:
    """A cache folder that holds the cell's data."""
    suite = load_suite(cell.suite)
    generator = np.random.default_rng(0)
    with TemporaryDirectory(prefix="lfobench-bench-") as folder:
        root = Path(folder)
        for request in requests(suite, cell.task, cell.recipe):
            part = PartCache(root, request.specification)
            for shard in range(request.specification.shards_for(request.transitions)):
                part.write(shard, _episodes(LENGTHS[request.specification.level], generator))
        yield root


def _episodes(length: int, generator: np.random.Generator) -> Episodes:
    count = SHARD_TRANSITIONS // length
    steps = count * length
    return Episodes(
        observations=generator.standard_normal((steps + count, OBSERVATION), np.float32),
        actions=generator.uniform(-1.0, 1.0, (steps, ACTION)).astype(np.float32),
        rewards=generator.standard_normal(steps, np.float32),
        lengths=np.full(count, length, np.int64),
        terminated=np.full(count, length < 1000),
    )


def cell_of(method: str, protocol: str, device: torch.device, steps: int | None = None) -> Cell:
    """The benchmark's task under a protocol."""
    request = Request(method, SUITE, TASK, protocol=protocol, device=device.type, assigned=Assigned(steps))
    (cell,) = make_plan(request, torch.cuda.is_available).cells
    return cell


def small(cell: Cell) -> Cell:
    """The cell with a hundredth of its data, for a run that only shows that everything runs."""
    whole = cell.task.recipe
    recipe = replace(whole, offline_transitions=SHARD_TRANSITIONS, expert_trajectories=5)
    task: Task = replace(cell.task, recipe=recipe)
    return replace(cell, task=task)


def loading(quick: bool, rounds: int) -> dict[str, Any]:
    """Seconds from files on disk to tables that a method can be trained on, files checked, in the page cache."""
    found: dict[str, Any] = {}
    for method in ("dilo", "smodice"):
        cell = cell_of(method, "paper", CPU)
        cell = small(cell) if quick else cell
        with built_task(cell) as root:

            def load(cell: Cell = cell, root: Path = root) -> int:
                data = load_task(root, load_suite(cell.suite), cell.task, cell.recipe, "")
                needs = cell.needs
                return view(cell.method, needs, data.mixture(needs), CPU).offline.rows

            rows = load()
            timing = alternate([Contender(method, load)], rounds=rounds, calls=1, warm_up=0)
        found[method] = {"rows": rows, "seconds": timing.timings[method].spread.as_json()}
    return found


def whole_cell(device: torch.device, seeds: int, evaluators: int, quick: bool) -> dict[str, Any]:
    """One DILO cell from data on disk to records, with its seconds by part.

    On CUDA the whole `paper` cell; on a CPU 400 steps of the `quick` protocol, whose parts show where time goes.
    """
    on_cuda = device.type == "cuda"
    cell = cell_of("dilo", "paper", device) if on_cuda else cell_of("dilo", "quick", device, steps=400)
    if quick:
        cell = small(replace(cell, protocol=replace(cell.protocol, assigned=Assigned(steps=20))))
    with built_task(cell) as root, TemporaryDirectory() as out:
        job = Job(cell, tuple(range(seeds)), Path(out), root, device.type, evaluators=evaluators)
        started = time.perf_counter()
        for _ in run_job(job, lambda: False):
            pass
        wall = time.perf_counter() - started
        record = RecordFolder(Path(out)).read_all().records[0]
    parts: dict[str, float] = dict(record.provenance["seconds"])
    concurrent = "evaluate" if evaluators else None
    rest = wall - sum(seconds for part, seconds in parts.items() if part != concurrent)
    return {
        "protocol": cell.protocol.name,
        "steps": cell.protocol.steps_for(cell.task),
        "seeds": seeds,
        "evaluations": len(record.evaluations),
        "wall_seconds": round(wall, 3),
        "seconds": {**{part: round(value, 3) for part, value in parts.items()}, "write and rest": round(rest, 3)},
        "evaluated_beside_training": bool(evaluators),
        "warnings": [warning.what for warning in record.warnings],
    }


def spread_of(found: dict[str, float]) -> Spread:
    """A spread from its JSON form."""
    return Spread(found["minimum"], found["median"], found["maximum"])
