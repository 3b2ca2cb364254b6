"""Evaluation by worker processes: the same numbers, from a state as it was, and failures that are heard of."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers_cli import PATIENCE
from helpers_engine import HOPPER_TASK, Drifting, FakeConfig, cell_of, smoke_cell
from test_evaluation import HOPPER, plain_loop, transform
from torch import Tensor

from lfobench.cells.cell import Cell
from lfobench.contract.method import Method, Shapes
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.evaluation import EpisodeResults, Evaluator
from lfobench.engine.evaluation_workers import Assignment, EvaluationError, EvaluationWorkers
from lfobench.engine.state import MethodState, SeedState, live_tensors

CPU = torch.device("cpu")
SEEDS, EPISODES = (4, 0, 7), 2
TRANSFORM = transform()
SHAPES = Shapes(TRANSFORM.size, 3)
POLE = ObservationTransform(np.zeros(4, np.float32), np.ones(4, np.float32), False)
POLE_SHAPES = Shapes(4, 1)


@cache
def dilo() -> Cell:
    """Layers of the released width: narrower ones take other paths through the matrix products."""
    cell = smoke_cell("dilo", HOPPER_TASK, "locomotion")
    assert cell.protocol.evaluation_episodes == EPISODES
    return replace(cell, config=cell.config.model_copy(update={"hidden": (256, 256)}))


def fresh() -> Method:
    cell = dilo()
    return cell.method(cell.config, SHAPES, SEEDS, CPU)


def in_this_process(method: Method) -> EpisodeResults:
    evaluator = Evaluator(HOPPER, TRANSFORM, len(SEEDS), range(EPISODES))
    found = evaluator.evaluate(method, CPU)
    evaluator.close()
    return found


def snapshot(method: Method) -> list[SeedState]:
    return MethodState.of(method, SHAPES, len(SEEDS)).capture()


def same(one: EpisodeResults, other: EpisodeResults) -> bool:
    arrays = ("returns", "lengths", "finite")
    pairs = [(getattr(one, name), getattr(other, name)) for name in arrays]
    return one.outcomes == other.outcomes and all(
        ours.dtype == theirs.dtype and np.array_equal(ours, theirs) for ours, theirs in pairs
    )


@pytest.fixture(scope="module", params=[1, 2])
def workers(request: pytest.FixtureRequest) -> Iterator[EvaluationWorkers]:
    pool = EvaluationWorkers(dilo(), TRANSFORM, SHAPES, SEEDS, request.param)
    yield pool
    pool.close()


@pytest.mark.slow
def test_workers_are_this_process_and_the_plain_loop(workers: EvaluationWorkers) -> None:
    method = fresh()
    workers.submit(40, snapshot(method))
    evaluated = workers.collect()
    returns, lengths = plain_loop(method, TRANSFORM, len(SEEDS), EPISODES)
    assert evaluated.step == 40
    assert evaluated.seconds > 0.0
    assert same(evaluated.results, in_this_process(method))
    assert evaluated.results.returns.tolist() == returns
    assert evaluated.results.lengths.tolist() == lengths
    assert len({tuple(row) for row in returns}) == len(SEEDS), "every seed has a policy of its own"


def test_evaluations_come_in_order_and_from_the_state_as_it_was(workers: EvaluationWorkers) -> None:
    method = fresh()
    expected = []
    for step, factor in ((10, 1.0), (20, 0.5), (30, -3.0)):
        live_tensors(method)["policy.network"].mul_(factor)
        expected.append(in_this_process(method))
        workers.submit(step, snapshot(method))
        live_tensors(method)["policy.network"].add_(1.0)
        live_tensors(method)["policy.network"].sub_(1.0)
    live_tensors(method)["policy.network"].zero_()
    assert workers.pending == 3
    assert workers.ready(timeout=PATIENCE)
    found = [workers.collect() for _ in range(3)]
    assert [evaluated.step for evaluated in found] == [10, 20, 30]
    assert same(found[0].results, expected[0])
    assert workers.pending == 0
    assert not workers.ready()


def test_a_seed_that_answers_nonsense_is_named(workers: EvaluationWorkers) -> None:
    method = fresh()
    live_tensors(method)["policy.network"][1] = torch.nan
    workers.submit(1, snapshot(method))
    found = workers.collect().results
    assert found.finite.tolist() == [True, False, True]
    assert np.isfinite(found.returns).all()
    assert same(found, in_this_process(method))


def test_interrupts_are_the_parents_business(workers: EvaluationWorkers) -> None:
    workers.submit(1, snapshot(fresh()))
    for process in multiprocessing.active_children():
        assert process.pid is not None
        os.kill(process.pid, signal.SIGINT)
    assert same(workers.collect().results, in_this_process(fresh()))


def test_a_seed_gets_its_own_share() -> None:
    states = [SeedState({"weight": torch.full((2,), float(seed))}, {"updates": seed}) for seed in SEEDS]
    share = Assignment(dilo(), TRANSFORM, SHAPES, SEEDS, 1, 3).part(states)
    assert [(arrays["weight"].tolist(), values) for arrays, values in share] == [
        ([float(seed)] * 2, {"updates": seed}) for seed in SEEDS[1:3]
    ]


def test_nothing_is_collected_before_it_is_submitted_and_workers_are_needed() -> None:
    pool = EvaluationWorkers(dilo(), TRANSFORM, SHAPES, SEEDS, 2)
    with pytest.raises(ValueError, match="no evaluation is pending"):
        pool.collect()
    with pytest.raises(ValueError, match="0 workers"):
        EvaluationWorkers(dilo(), TRANSFORM, SHAPES, SEEDS, 0)


class Fragile(Drifting):
    """Has a bug that only acting meets."""

    name = "fragile"

    def act(self, observation: Tensor) -> Tensor:
        raise RuntimeError("a bug in somebody's policy")


def drifting(seeds: int) -> list[SeedState]:
    return MethodState.of(Drifting(FakeConfig(), POLE_SHAPES, range(seeds), CPU), POLE_SHAPES, seeds).capture()


def started(pool: EvaluationWorkers, state: list[SeedState]) -> list[int]:
    """Submit `state` to a fresh pool; the ids of the processes that it started."""
    before = {process.pid for process in multiprocessing.active_children()}
    pool.submit(7, state)
    return [child.pid for child in multiprocessing.active_children() if child.pid and child.pid not in before]


def assert_gone(processes: list[int]) -> None:
    assert processes
    for process in processes:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


@pytest.mark.slow
def test_a_bug_in_a_worker_is_raised_here() -> None:
    pool = EvaluationWorkers(cell_of(Fragile), POLE, POLE_SHAPES, [0], 1)
    processes = started(pool, drifting(1))
    with pytest.raises(EvaluationError) as caught:
        pool.collect()
    assert str(caught.value).endswith("at step 7 failed: RuntimeError: a bug in somebody's policy")
    assert "fragile" in str(caught.value)
    assert ", in act\n" in str(caught.value.__cause__), "the worker's own traceback"
    assert_gone(processes)


def test_a_worker_that_dies_is_missed() -> None:
    pool = EvaluationWorkers(cell_of(Drifting), POLE, POLE_SHAPES, [0, 1], 2)
    processes = started(pool, drifting(2))
    os.kill(processes[0], signal.SIGKILL)
    with pytest.raises(EvaluationError, match=r"step 7 failed: its worker process died \(exit code -9\)"):
        pool.ready(timeout=None)
    assert pool.pending == 0
    assert_gone(processes)


def test_closing_leaves_nothing_behind_whatever_the_workers_are_at() -> None:
    """The state is larger than a pipe holds, so it is still on its way."""
    pool = EvaluationWorkers(cell_of(Drifting), POLE, POLE_SHAPES, [0, 1], 2)
    large = [SeedState({**each.tensors, "rest": torch.zeros(1_000_000)}, each.values) for each in drifting(2)]
    processes = started(pool, large)
    assert len(processes) == 2
    pool.close()
    assert_gone(processes)


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["sys.exit(3)", "os.kill(os.getpid(), signal.SIGKILL)"])
def test_a_parent_that_forgets_its_workers_or_is_killed_takes_them_along(ending: str, tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    body = f"""
        import multiprocessing, os, signal, sys
        sys.path[:0] = {sys.path!r}
        from test_evaluation_workers import *

        if __name__ == "__main__":
            pool = EvaluationWorkers(cell_of(Drifting), POLE, POLE_SHAPES, [0, 1], 2)
            for _ in range(2):
                pool.submit(1, drifting(2))
            pool.collect()
            print(*(child.pid for child in multiprocessing.active_children()), flush=True)
            {ending}
    """
    script.write_text(textwrap.dedent(body))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode in (3, -9), done.stderr
    processes = [int(word) for word in done.stdout.split()]
    assert len(processes) == 2
    for process in processes:
        wait_until_gone(process)


def wait_until_gone(process: int) -> None:
    for _ in range(int(PATIENCE / 0.1)):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    raise AssertionError(f"process {process} lives on")
