"""Evaluation in lock step against the plain loop, and the same starts for everyone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from helpers_engine import HOPPER_TASK, SMOKE, Drifting, FakeConfig, smoke_cell
from torch import Tensor

from lfobench.contract.method import Method, Shapes
from lfobench.contract.suite import Task
from lfobench.data.mixing import ObservationTransform
from lfobench.engine import evaluation
from lfobench.engine.evaluation import Evaluator, start_seed
from lfobench.registry import load_suite

CPU = torch.device("cpu")
HOPPER = next(task for task in load_suite("locomotion").tasks if task.name == HOPPER_TASK)
SEEDS, EPISODES = 2, 3


def transform(indicator: bool = False) -> ObservationTransform:
    shift = np.linspace(-0.5, 0.5, 11, dtype=np.float32)
    return ObservationTransform(shift, np.linspace(0.5, 2.0, 11, dtype=np.float32), indicator)


def plain_loop(
    method: Method, change: ObservationTransform, seeds: int = SEEDS, episodes: int = EPISODES
) -> tuple[list[list[float]], list[list[int]]]:
    """One environment, one episode at a time, one observation at a time; the other rows of a batch are empty."""
    returns: list[list[float]] = []
    lengths: list[list[int]] = []
    for seed in range(seeds):
        returns.append([])
        lengths.append([])
        for episode in range(episodes):
            environment = HOPPER.environment.make()
            observation, _ = environment.reset(seed=start_seed(HOPPER, episode))
            total, steps, over = 0.0, 0, False
            while not over:
                batch = torch.zeros(seeds, episodes, change.size)
                batch[seed, episode] = torch.from_numpy(change(np.asarray(observation, np.float32)))
                action = method.act(batch)[seed, episode].detach().numpy()
                observation, reward, terminated, truncated, _ = environment.step(action)
                total, steps, over = total + float(reward), steps + 1, terminated or truncated
            environment.close()
            returns[-1].append(total)
            lengths[-1].append(steps)
    return returns, lengths


@pytest.mark.parametrize("kind", ["drifting", "bc", "dilo"])
@pytest.mark.parametrize("indicator", [False, True])
def test_lock_step_is_the_plain_loop(kind: str, indicator: bool) -> None:
    change = transform(indicator)
    shapes = Shapes(change.size, 3)
    method: Method
    if kind == "drifting":
        method = Drifting(FakeConfig(), shapes, [0, 1], CPU)
    else:
        cell = smoke_cell(kind, HOPPER_TASK, "locomotion")
        method = cell.method(cell.config, shapes, [0, 1], CPU)
    evaluator = Evaluator(HOPPER, change, SEEDS, range(EPISODES))
    found = evaluator.evaluate(method, CPU)
    evaluator.close()
    returns, lengths = plain_loop(method, change)
    assert found.returns.tolist() == returns
    assert found.lengths.tolist() == lengths
    assert len({length for row in lengths for length in row}) > 1, "episodes of unequal length ran side by side"


class Watching(Drifting):
    """Keeps what it is shown."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.shown: list[Tensor] = []

    def act(self, observation: Tensor) -> Tensor:
        self.shown.append(observation.clone())
        return super().act(observation)


def watching(seeds: list[int]) -> Watching:
    return Watching(FakeConfig(), Shapes(11, 3), seeds, CPU)


def first_observations(task: Task, seeds: list[int], times: int = 1) -> list[Tensor]:
    method = watching(seeds)
    zeros = np.zeros(11, np.float32)
    evaluator = Evaluator(task, ObservationTransform(zeros, zeros + 1, False), len(seeds), range(EPISODES))
    starts = []
    for _ in range(times):
        before = len(method.shown)
        evaluator.evaluate(method, CPU)
        starts.append(method.shown[before])
    evaluator.close()
    return starts


def test_every_seed_step_and_method_starts_alike() -> None:
    """Seeds act differently, so their later observations differ; the first ones may not."""
    first, second = first_observations(HOPPER, [0, 7], times=2)
    (other,) = first_observations(HOPPER, [5])
    assert torch.equal(first[0], first[1])
    assert torch.equal(first, second)
    assert torch.equal(other[0], first[0])


def test_episodes_and_tasks_start_differently() -> None:
    (starts,) = first_observations(HOPPER, [0])
    assert len({tuple(row.tolist()) for row in starts[0]}) == EPISODES
    (elsewhere,) = first_observations(replace(HOPPER, name="hopper-other"), [0])
    assert not torch.equal(starts, elsewhere)


def test_starts_are_written_down() -> None:
    """Changing them would make new records incomparable with old ones under an unchanged identity."""
    assert [start_seed(HOPPER, episode) for episode in range(3)] == [3291915398, 3006370832, 708363690]


def test_a_longer_evaluation_begins_with_the_shorter_one() -> None:
    method, zeros = watching([0]), np.zeros(11, np.float32)
    results = []
    for episodes in (2, 4):
        evaluator = Evaluator(HOPPER, ObservationTransform(zeros, zeros + 1, False), 1, range(episodes))
        results.append(evaluator.evaluate(method, CPU))
        evaluator.close()
    assert results[1].returns[0, :2].tolist() == results[0].returns[0].tolist()


@pytest.mark.parametrize("answer", [float("nan"), float("inf"), float("-inf")])
def test_a_policy_that_answers_nonsense_does_not_reach_the_simulator(answer: float) -> None:
    class Nonsense(Drifting):
        def act(self, observation: Tensor) -> Tensor:
            action = super().act(observation)
            action[0] = answer
            return action

    zeros = np.zeros(11, np.float32)
    evaluator = Evaluator(HOPPER, ObservationTransform(zeros, zeros + 1, False), 2, range(2))
    found = evaluator.evaluate(Nonsense(FakeConfig(), Shapes(11, 3), [0, 1], CPU), CPU)
    evaluator.close()
    assert np.isfinite(found.returns).all()
    assert (found.lengths > 0).all()
    assert found.finite.tolist() == [False, True]


def test_what_a_finished_episode_is_answered_does_not_count() -> None:
    """Its slot still holds the last observation; a policy may answer that with anything."""

    class LateNonsense(Drifting):
        calls, sound_calls = 0, 0

        def act(self, observation: Tensor) -> Tensor:
            action = super().act(observation)
            self.calls += 1
            action[0, int(ended.argmin()), :] *= torch.nan if self.calls > self.sound_calls else 1.0
            return action

    zeros = np.zeros(11, np.float32)
    evaluator = Evaluator(HOPPER, ObservationTransform(zeros, zeros + 1, False), 1, range(EPISODES))
    method = LateNonsense(FakeConfig(), Shapes(11, 3), [0], CPU)
    ended = evaluator.evaluate(Drifting(FakeConfig(), Shapes(11, 3), [0], CPU), CPU).lengths[0]
    assert ended.min() < ended.max()
    for sound_calls, finite in ((int(ended.min()), True), (int(ended.min()) - 1, False)):
        method.calls, method.sound_calls = 0, sound_calls
        found = evaluator.evaluate(method, CPU)
        assert found.finite.tolist() == [finite]
        assert found.lengths.max() == ended.max()
    evaluator.close()


def test_the_horizon_ends_an_episode() -> None:
    short = replace(HOPPER, environment=replace(HOPPER.environment, horizon=4))
    zeros = np.zeros(11, np.float32)
    evaluator = evaluation.Evaluator(short, ObservationTransform(zeros, zeros + 1, False), 1, range(2))
    found = evaluator.evaluate(watching([0]), CPU)
    evaluator.close()
    assert found.lengths.tolist() == [[4, 4]]
    assert SMOKE.evaluation_episodes == 2
