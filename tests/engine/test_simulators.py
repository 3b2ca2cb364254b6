"""Both forms of a simulator give the same episodes, and say how they ended."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers_engine import Drifting, finish, make_job, records_of, smoke_cell
from scene_suite import ALONE, REACH, around
from torch import Tensor

from lfobench.cells.cell import Cell
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.evaluation import EpisodeResults, OneByOne, Simulators, Together, rollout, simulators
from lfobench.engine.policy import load_policy
from lfobench.python_files import load_file
from lfobench.record import SUCCESS
from lfobench.records.folder import RecordFolder
from lfobench.tables.counting import successes_of

OWN = load_file(Path(__file__).parents[1] / "own_folder" / "own_suite.py", "suite")
SCENES = str(Path(__file__).parents[1] / "scene_suite.py")
ZEROS = np.zeros(2, np.float32)
SEEN = ObservationTransform(ZEROS, ZEROS + 1, False)
STARTS = [3, 1, 4, 1, 5]


def steer(observation: Tensor) -> Tensor:
    """Seed 0 goes round the cup, seed 1 straight at it, seed 2 nowhere."""
    actions = torch.zeros_like(observation)
    actions[0] = torch.from_numpy(around(observation[0].numpy()))
    actions[1, :, 0] = 0.3
    return actions


def run(worlds: Simulators) -> EpisodeResults:
    found = rollout(steer, SEEN, worlds, STARTS)
    worlds.close()
    return found


def test_the_form_is_the_environments_best() -> None:
    assert isinstance(simulators(REACH, 2), Together)
    assert isinstance(simulators(ALONE, 2), OneByOne)


def test_a_vector_environment_is_its_single_ones_side_by_side() -> None:
    together, one_by_one = run(simulators(REACH, 15)), run(OneByOne([REACH.make() for _ in range(15)]))
    assert np.array_equal(together.returns, one_by_one.returns)
    assert np.array_equal(together.lengths, one_by_one.lengths)
    assert len(np.unique(together.lengths)) > 1


@pytest.mark.parametrize("identifier", ["Cart-v0", "Carts-v0"])
@pytest.mark.parametrize(("actions", "highest"), [("one", 1.0), ("two", 2.0), ("skew", 2.0), ("unbounded", 1.0)])
def test_a_method_s_actions_reach_the_simulator_in_its_own_units(identifier: str, actions: str, highest: float) -> None:
    """Rewards of these worlds are sums of the action that arrived."""
    environment = OWN.environment(actions, identifier=identifier)
    size = len(environment.spaces.actions.low)
    transform = ObservationTransform(np.zeros(2, np.float32), np.ones(2, np.float32), False)
    found = rollout(lambda seen: torch.ones(*seen.shape[:2], size), transform, simulators(environment, 2), [1, 2])
    assert isinstance(simulators(environment, 1), Together if identifier == "Carts-v0" else OneByOne)
    assert found.returns.tolist() == [[highest * environment.horizon] * 2]


def test_how_an_episode_ended_is_told_of_each() -> None:
    outcomes = run(simulators(REACH, 15)).outcomes
    assert outcomes is not None
    assert outcomes[0] == [SUCCESS] * 5
    assert set(outcomes[1]) <= {"cup hit", "out of time", SUCCESS} and "cup hit" in outcomes[1]
    assert outcomes[2] == ["out of time"] * 5


def test_environments_that_do_not_say_have_no_outcomes() -> None:
    assert run(simulators(ALONE, 15)).outcomes is None


# --- a whole run -----------------------------------------------------------------------------------------------------


@pytest.fixture
def cell() -> Cell:
    found = smoke_cell("bc", "reach-few", SCENES)
    return replace(found, protocol=replace(found.protocol, further_episodes=7))


def test_the_trained_policy_is_run_from_further_starts(cell: Cell, tmp_path: Path, shared_cache: Path) -> None:
    job = make_job(cell, [0, 1], tmp_path, shared_cache)
    finish(job)
    for record in records_of(job):
        assert record.further is not None
        assert (record.further.step, len(record.further.returns)) == (40, 7)
        assert record.further.outcomes is not None
        assert record.further.successes == sum(record.further.returns)
        assert record.evaluations[-1].outcomes is not None


def test_further_starts_change_nothing_else(cell: Cell, tmp_path: Path, shared_cache: Path) -> None:
    plain = replace(cell, protocol=replace(cell.protocol, further_episodes=0))
    jobs = [make_job(each, [0], tmp_path / name, shared_cache) for each, name in ((cell, "a"), (plain, "b"))]
    for job in jobs:
        finish(job)
    (with_more,), (without,) = (records_of(job) for job in jobs)
    assert with_more.evaluations == without.evaluations
    assert without.further is None
    assert "further_episodes" not in without.identity["protocol"]


class Late(Drifting):
    """Answers one of its further starts with nonsense, in its second seed."""

    def act(self, observation: Tensor) -> Tensor:
        actions = torch.zeros(*observation.shape[:2], 2)
        if observation.shape[1] == 7 and len(observation) > 1:
            actions[1, 3] = torch.nan
        return actions


def test_a_policy_that_answers_a_further_start_with_nonsense_has_diverged(
    cell: Cell, tmp_path: Path, shared_cache: Path
) -> None:
    late = replace(cell, method=Late, config=Late.Config(), budget={}, assigned={})
    job = make_job(late, [0, 1], tmp_path, shared_cache)
    finish(job)
    sound, broken = records_of(job)
    assert (sound.status, broken.status) == ("finished", "diverged")
    assert (broken.diverged_at, broken.further) == (40, None)
    assert any("Non-finite values at step 40" in warning.what for warning in broken.warnings)
    assert successes_of([sound, broken]).pooled.trials == 2 * (2 + 7)


def test_starts_of_a_choice_are_not_those_of_the_tests(cell: Cell, tmp_path: Path, shared_cache: Path) -> None:
    chosen = replace(cell, starts="validation")
    assert chosen.identity["starts"] == "validation"
    assert "starts" not in cell.identity
    jobs = [make_job(each, [0], tmp_path / name, shared_cache) for each, name in ((cell, "a"), (chosen, "b"))]
    for job in jobs:
        finish(job)
    (test,), (validation,) = (records_of(job) for job in jobs)
    assert test.metrics == validation.metrics, "the same training"
    assert test.further is not None and validation.further is not None
    assert test.further.lengths != validation.further.lengths or test.evaluations != validation.evaluations


def test_the_policy_that_is_kept_does_what_was_evaluated(cell: Cell, tmp_path: Path, shared_cache: Path) -> None:
    """Its episodes from the further starts end after as many steps, with the same outcome."""
    from lfobench.engine.evaluation import start_seed

    job = make_job(cell, [0, 1], tmp_path, shared_cache)
    finish(job)
    for record in records_of(job):
        assert record.further is not None
        policy = load_policy(RecordFolder(tmp_path), record)
        starts = [start_seed(cell.task, episode) for episode in range(2, 9)]

        def act(observation: Tensor, policy: object = policy) -> Tensor:
            return torch.from_numpy(policy.act(observation[0].numpy()))[None]  # type: ignore[attr-defined]

        found = rollout(act, SEEN, simulators(REACH, 7), starts)
        assert found.lengths[0].tolist() == record.further.lengths
        assert found.outcomes == [record.further.outcomes]
