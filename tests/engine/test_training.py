"""Training while workers evaluate, and on several threads: the records of doing one thing after another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from helpers_engine import (
    SMOKE,
    Drifting,
    FakeConfig,
    StopAfter,
    cell_of,
    finish,
    make_job,
    records_of,
    smoke_cell,
)
from torch import Tensor

from lfobench.cells.cell import Cell
from lfobench.contract.method import Batch, Metrics, Shapes
from lfobench.engine import checkpoint
from lfobench.engine.job import Job, Recorded
from lfobench.engine.training import Advance
from lfobench.randomness import StepRandomness
from lfobench.records.folder import RecordFolder
from lfobench.score import Statistic


def measured(job: Job) -> list[dict[str, Any]]:
    return [record.measured() for record in records_of(job)]


def in_turn_and_beside(cell: Cell, seeds: Sequence[int], out: Path, cache: Path) -> tuple[Job, Job]:
    """The same runs evaluated in this process, and by two others beside it."""
    in_turn = make_job(cell, seeds, out / "in turn", cache)
    return in_turn, replace(make_job(cell, seeds, out / "beside", cache), evaluators=2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dilo", "bco"])
def test_evaluation_beside_training_changes_no_record(name: str, tmp_path: Path, shared_cache: Path) -> None:
    """Of a method with one stage and of one with two, at the protocol's steps and at the last one."""
    cell = replace(smoke_cell(name), protocol=replace(SMOKE, steps=45))
    in_turn, beside = in_turn_and_beside(cell, [0, 4, 2], tmp_path, shared_cache)
    finish(in_turn)
    events = finish(beside)
    assert measured(beside) == measured(in_turn)
    steps = [evaluation.step for evaluation in records_of(beside)[0].evaluations]
    assert steps == [10, 20, 30, 40, 45]
    advances = [event for event in events if isinstance(event, Advance)]
    assert [event.done for event in advances] == sorted(event.done for event in advances)
    assert advances[-1].done == advances[-1].total
    last = records_of(beside)
    assert advances[-1].score == pytest.approx(sum(record.score(Statistic("last")) for record in last) / len(last))
    assert [event.run for event in events if isinstance(event, Recorded)] == [run.label for run in beside.runs]
    assert all(record.provenance["seconds"]["evaluate"] > 0.0 for record in last)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("always_saving", "stops"), [(False, (5, 17)), (True, (20,))], ids=["at stops", "after every step"]
)
def test_a_stop_while_workers_evaluate_loses_nothing(
    always_saving: bool, stops: tuple[int, ...], tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped in the first stage, right after an evaluation was handed over, and between two."""
    in_turn, beside = in_turn_and_beside(cell_of(Drifting), [0, 4], tmp_path, shared_cache)
    finish(in_turn)
    if always_saving:
        monkeypatch.setattr(checkpoint, "SECONDS_BETWEEN", -1.0)
    for questions in stops:
        finish(beside, StopAfter(questions))
        folder = RecordFolder(beside.out)
        assert all(folder.checkpoint(run).exists() and not folder.find(run) for run in beside.runs)
    finish(beside)
    assert measured(beside) == measured(in_turn)


@pytest.mark.slow
def test_a_checkpoint_is_continued_with_any_number_of_evaluators(tmp_path: Path, shared_cache: Path) -> None:
    in_turn, beside = in_turn_and_beside(cell_of(Drifting), [0, 4], tmp_path, shared_cache)
    finish(in_turn)
    finish(beside, StopAfter(27))
    finish(replace(beside, evaluators=0))
    assert measured(beside) == measured(in_turn)


@pytest.mark.slow
def test_dying_while_workers_evaluate_loses_no_number(tmp_path: Path, shared_cache: Path) -> None:
    """The last checkpoint is of step 3 of the main stage; the evaluation of step 10 was under way and is repeated."""
    in_turn, beside = in_turn_and_beside(cell_of(Drifting), [0, 4], tmp_path, shared_cache)
    finish(in_turn)
    finish(beside, StopAfter(10))

    class Killed(BaseException):
        pass

    left = [15]

    def kill() -> bool:
        left[0] -= 1
        if left[0] < 0:
            raise Killed
        return False

    with pytest.raises(Killed):
        finish(beside, kill)
    finish(beside)
    assert measured(beside) == measured(in_turn)


class Rooted(Drifting):
    """The poisoned seed's actions turn NaN while its state stays finite; ten updates later its weights follow."""

    name = "rooted"

    def __init__(self, config: FakeConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        self.square = torch.ones(len(seeds), 1, 1)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        found = super().update(stage, offline, expert, randomness)
        sick = [index for index, seed in enumerate(self.seeds) if seed == self.config.poisoned_seed]
        if self.drifts > self.config.poisoned_step:
            self.square[sick] = -1.0
        if self.drifts > self.config.poisoned_step + 10:
            self.weight[sick] = torch.nan
        return found

    def act(self, observation: Tensor) -> Tensor:
        return super().act(observation) * torch.sqrt(self.square)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "noticed_at", "kept"), [(Drifting, 20, 1), (Rooted, 20, 1)], ids=["in the state", "in the actions"]
)
def test_a_seed_diverges_at_the_same_step(
    method: type[Drifting], noticed_at: int, kept: int, tmp_path: Path, shared_cache: Path
) -> None:
    """Also where only its answers tell, and they come back after the state of a later step was looked at."""
    where = {"poisoned_seed": 4, "poisoned_step": 12}
    if method is Rooted:
        where["where"] = "action"  # type: ignore[assignment]
    in_turn, beside = in_turn_and_beside(cell_of(method, **where), [0, 4], tmp_path, shared_cache)
    finish(in_turn)
    finish(beside)
    assert measured(beside) == measured(in_turn)
    healthy, sick = records_of(beside)
    assert (sick.status, sick.diverged_at, len(sick.evaluations)) == ("diverged", noticed_at, kept)
    assert (healthy.status, len(healthy.evaluations)) == ("finished", 4)


# --- threads ---------------------------------------------------------------------------------------------------------


def test_a_job_says_how_many_threads_it_had(tmp_path: Path, shared_cache: Path) -> None:
    """No step is large enough here to be shared out; `tests/methods/test_threads.py` has larger ones."""
    jobs = [
        replace(make_job(cell_of(Drifting), [0], tmp_path / str(threads), shared_cache), threads=threads)
        for threads in (1, 2)
    ]
    try:
        for job in jobs:
            finish(job)
            assert records_of(job)[0].provenance["device"]["threads"] == job.threads
    finally:
        torch.set_num_threads(1)
    assert measured(jobs[0]) == measured(jobs[1])
