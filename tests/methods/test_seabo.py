"""SEABO's labels, and the points of its learner that a single update shows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from method_helpers import CPU, NO_BATCH, GivenRandomness, make_batch
from torch import Tensor

from lfobench.contract.method import Shapes, Trajectories, UnsuitableData
from methods.seabo import Seabo, SeaboConfig

SHAPES = Shapes(observation=2, action=3)


def trajectories(*observations: list[list[float]], actions: bool = True) -> Trajectories:
    lengths = torch.tensor([len(each) - 1 for each in observations])
    rows = int(lengths.sum())
    return Trajectories(
        torch.tensor([row for each in observations for row in each]),
        torch.zeros(rows, SHAPES.action) if actions else None,
        lengths,
        torch.zeros(len(observations), dtype=torch.bool),
    )


def labels(offline: Trajectories, expert: Trajectories, **fields: Any) -> Tensor:
    return Seabo.prepare(SeaboConfig(**fields), offline, expert, (0,), lambda done: None)


EXPERT = trajectories([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], actions=False)


def test_a_transition_of_the_experts_gets_the_largest_reward_and_a_distance_of_six_its_share() -> None:
    found = labels(trajectories([[0.0, 0.0], [1.0, 0.0]], [[0.0, 6.0], [1.0, 0.0]]), EXPERT, scale=1.0)
    # beta d / D = 0.5 * 6 / 3.
    torch.testing.assert_close(found, torch.tensor([1.0, math.exp(-1.0)]))
    assert labels(trajectories([[1.0, 0.0], [2.0, 0.0]]), EXPERT, scale=10.0).item() == 10.0


def test_labels_depend_on_no_order() -> None:
    one = [[0.3, 0.1], [0.9, -2.0], [5.0, 0.0]]
    other = [[4.0, 4.0], [0.0, 0.5]]
    forward = labels(trajectories(one, other), EXPERT)
    backward = labels(trajectories(other, one), EXPERT)
    torch.testing.assert_close(forward, torch.cat((backward[1:], backward[:1])))
    assert bool(((forward > 0) & (forward <= 1)).all())


def test_the_kth_neighbour_and_the_mean_of_k() -> None:
    query = trajectories([[0.0, 0.0], [1.0, 0.0]])
    # Distances to the expert's two transitions: 0 and sqrt(2).
    second = math.exp(-0.5 * math.sqrt(2.0) / 3.0)
    middle = math.exp(-0.5 * math.sqrt(2.0) / 6.0)
    torch.testing.assert_close(labels(query, EXPERT, neighbours=2), torch.tensor([second]))
    torch.testing.assert_close(labels(query, EXPERT, neighbours=2, distance="mean"), torch.tensor([middle]))


def test_a_successor_that_is_not_recorded_is_no_neighbour_and_has_no_reward() -> None:
    unknown = [[0.0, 0.0], [1.0, 0.0], [math.nan, math.nan]]
    found = labels(trajectories(unknown), trajectories(unknown, actions=False))
    torch.testing.assert_close(found, torch.tensor([1.0, 0.0]))


def test_fewer_expert_transitions_than_neighbours_are_refused() -> None:
    with pytest.raises(UnsuitableData, match=r"3 neighbours.*2 transitions") as refused:
        labels(trajectories([[0.0, 0.0], [1.0, 0.0]]), EXPERT, neighbours=3)
    assert "at most 2" in refused.value.remedy


def test_progress_ends_at_one() -> None:
    seen: list[float] = []
    Seabo.prepare(SeaboConfig(), trajectories([[0.0, 0.0], [1.0, 0.0]]), EXPERT, (0,), seen.append)
    assert seen[-1] == 1.0


def test_an_expectile_of_a_half_is_half_the_squared_error() -> None:
    seabo = Seabo(SeaboConfig(hidden=(8, 8), expectile=0.5), SHAPES, (0, 1), CPU)
    advantage = torch.randn(2, 7, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(seabo.iql.expectile_loss(advantage), 0.5 * advantage.square().mean(-1))


@pytest.mark.parametrize(("inverse_temperature", "reached"), [(3.0, 1.535), (0.5, 9.21), (10.0, 0.4605)])
def test_the_weight_reaches_its_limit_at_the_advantage_that_the_formula_says(
    inverse_temperature: float, reached: float
) -> None:
    seabo = Seabo(SeaboConfig(hidden=(8, 8), inverse_temperature=inverse_temperature), SHAPES, (0,), CPU)
    observation = torch.zeros(1, 2, SHAPES.observation)
    value = seabo.iql.value(observation).squeeze(-1).detach()
    below, above = seabo.iql.policy_weights(value + torch.tensor([[reached - 0.01, reached + 0.01]]), observation)[0]
    assert float(below) < 100.0 and float(above) == 100.0


def test_the_policy_takes_no_part_in_the_critics() -> None:
    seabo = Seabo(SeaboConfig(hidden=(8, 8), learning_rate=1e-2), SHAPES, (0,), CPU)
    batch = make_batch(Seabo.needs(seabo.config).offline, SHAPES, 1, 16, np.random.default_rng(0))
    other = Seabo(SeaboConfig(hidden=(8, 8), learning_rate=1e-2, inverse_temperature=0.0), SHAPES, (0,), CPU)
    for each in (seabo, other):
        each.update("policy", batch, NO_BATCH, GivenRandomness())
    assert torch.equal(seabo.iql.critic.flat, other.iql.critic.flat)
    assert torch.equal(seabo.iql.value.flat, other.iql.value.flat)
    assert not torch.equal(seabo.act(batch["observation"]), other.act(batch["observation"]))
