"""Methods with ordinary modules in whole jobs: they resume bit for bit and are scored as trained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from helpers_engine import SMOKE, StopAfter, cell_of, finish, make_job, records_of
from helpers_methods import SOUND, Adapted, Momentum, Naive

from lfobench.contract.method import Method
from lfobench.engine import job as engine_job
from lfobench.engine import policy as policies
from lfobench.engine.job import Job
from lfobench.engine.policy import load_policy
from lfobench.records.folder import RecordFolder
from lfobench.tensor_files import read_tensors, write_tensors

SEEDS = (0, 4, 2)


def measured(job: Job) -> list[dict[str, Any]]:
    return [record.measured() for record in records_of(job)]


@pytest.mark.parametrize("method", SOUND)
def test_a_killed_job_goes_on_in_any_grouping(method: type[Method], tmp_path: Path, shared_cache: Path) -> None:
    """Three seeds together, then one alone and two together, then each alone: the records of one sitting."""
    straight = make_job(cell_of(method), SEEDS, tmp_path / "straight", shared_cache)
    finish(straight)
    broken = make_job(cell_of(method), SEEDS, tmp_path / "broken", shared_cache)
    assert finish(broken, StopAfter(13))
    for seeds, stop in (((4,), 9), ((2, 0), 5), ((0,), 99), ((2,), 99), ((4,), 99)):
        finish(replace(broken, seeds=seeds), StopAfter(stop))
    assert measured(broken) == measured(straight)


def test_no_step_is_trained_twice_when_seeds_are_grouped_otherwise(
    tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    updates = [0]
    genuine = Momentum.update

    def counted(self: Momentum, *arguments: Any) -> Any:
        updates[0] += len(self.weight)
        return genuine(self, *arguments)

    monkeypatch.setattr(Momentum, "update", counted)
    job = make_job(cell_of(Momentum), SEEDS, tmp_path, shared_cache)
    finish(job, StopAfter(17))
    finish(replace(job, seeds=(4,)), StopAfter(6))
    finish(replace(job, seeds=(2, 4)), StopAfter(3))
    finish(job)
    assert updates[0] == len(SEEDS) * (SMOKE.steps or 0)
    assert [record.status for record in records_of(job)] == ["finished"] * 3


def test_a_checkpoint_that_does_not_fit_starts_its_own_seed_afresh(tmp_path: Path, shared_cache: Path) -> None:
    """The file is whole and of this run, and holds a tensor that the method does not know."""
    straight = make_job(cell_of(Naive), SEEDS, tmp_path / "straight", shared_cache)
    finish(straight)
    job = make_job(cell_of(Naive), SEEDS, tmp_path / "broken", shared_cache)
    finish(job, StopAfter(13))
    path = RecordFolder(job.out).checkpoint(job.runs[1])
    tensors, about = read_tensors(path)
    write_tensors(path, {**tensors, "zzz": torch.zeros(2)}, about)
    finish(job)
    assert measured(job) == measured(straight)


class Transforming(Momentum):
    """Its own tensors are named as the harness would name those of its transform."""

    name = "transforming"

    def __init__(self, config: Any, shapes: Any, seeds: Any, device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        self.transform = {"shift": torch.zeros(len(seeds), 1, 1), "scale": torch.ones(len(seeds), 1, 1)}

    def update(self, stage: str, offline: Any, expert: Any, randomness: Any) -> Any:
        self.transform["shift"] += 0.5 * offline["observation"].mean((1, 2), keepdim=True)
        return super().update(stage, offline, expert, randomness)

    def act(self, observation: torch.Tensor) -> torch.Tensor:
        return super().act((observation - self.transform["shift"]) * self.transform["scale"])


@pytest.mark.slow
@pytest.mark.parametrize("method", [Naive, Adapted])
def test_evaluation_processes_score_the_trained_network(
    method: type[Method], tmp_path: Path, shared_cache: Path
) -> None:
    in_turn = make_job(cell_of(method, rate=0.3), SEEDS, tmp_path / "in turn", shared_cache)
    beside = replace(make_job(cell_of(method, rate=0.3), SEEDS, tmp_path / "beside", shared_cache), evaluators=2)
    finish(in_turn)
    finish(beside)
    assert measured(beside) == measured(in_turn)
    for record in records_of(beside):
        assert len({tuple(evaluation.returns) for evaluation in record.evaluations}) > 1, "it learns something"


@pytest.mark.parametrize("method", [*SOUND, Transforming])
def test_the_policy_file_holds_the_trained_weights(
    method: type[Method], tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(policies, "load_method", lambda name: method)
    job = make_job(cell_of(method), SEEDS, tmp_path, shared_cache)
    finish(job)
    folder = RecordFolder(tmp_path)
    observation = np.linspace(-1, 1, 12, dtype=np.float32).reshape(3, 4)
    actions = [load_policy(folder, record).act(observation) for record in records_of(job)]
    untrained = method(method.Config(), policies.Shapes(4, 1), SEEDS, torch.device("cpu"))
    with torch.no_grad():
        before = untrained.act(torch.from_numpy(observation)[None].expand(3, -1, -1)).numpy()
    assert not any(np.allclose(after, start) for after, start in zip(actions, before, strict=True))
    assert len({tuple(action.ravel()) for action in actions}) == 3
    alone = replace(job, seeds=(4,), out=tmp_path / "alone")
    with pytest.MonkeyPatch.context() as patch:
        kept: list[Any] = []
        genuine = policies.save_policy
        patch.setattr(engine_job, "save_policy", lambda *given: (kept.append(given[3].method), genuine(*given)))
        finish(alone)
    with torch.no_grad():
        seen = kept[0].act(torch.from_numpy(observation)[None])[0].numpy()
    assert np.array_equal(actions[1], seen), "the policy of seed 4, read back, acts as the method did when trained"


def test_equal_policies_are_equal_bytes_and_a_changed_one_is_refused(
    tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(policies, "load_method", lambda name: Naive)
    jobs = [make_job(cell_of(Naive), [1], tmp_path / name, shared_cache) for name in ("one", "two")]
    for job in jobs:
        finish(job)
    paths = [RecordFolder(job.out).policy(records_of(job)[0]) for job in jobs]
    content = paths[0].read_bytes()
    assert content == paths[1].read_bytes()
    (record,) = records_of(jobs[1])
    generator = np.random.default_rng(0)
    intact = load_policy(RecordFolder(jobs[1].out), record).act(np.ones((1, 4), np.float32))
    for place in generator.integers(0, len(content), 60):
        damaged = bytearray(content)
        damaged[place] ^= int(generator.integers(1, 256))
        paths[1].write_bytes(damaged)
        try:
            found = load_policy(RecordFolder(jobs[1].out), record).act(np.ones((1, 4), np.float32))
        except policies.UserError:
            continue
        assert np.array_equal(found, intact), place
