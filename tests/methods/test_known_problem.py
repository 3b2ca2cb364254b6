"""A problem whose answer is known exactly: a slippery 3x3 grid, discrete actions encoded as vectors.

The offline data come from a policy that mostly walks away from the expert's goal, plus some expert episodes; a
clone of the mix therefore fails, and only a method that finds the expert's part of it succeeds. The data go through
the benchmark's own path: episodes, recipe, firewall, sampler.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from method_helpers import CPU, train
from numpy.typing import NDArray

from lfobench import registry
from lfobench.contract.episodes import Episodes
from lfobench.contract.suite import Recipe
from lfobench.data.firewall import view
from lfobench.data.mixing import mix

Array = NDArray[np.float64]

SIDE, SLIP, DISCOUNT, HORIZON = 3, 0.1, 0.9, 20
MOVES = ((0, 1), (0, -1), (1, 0), (-1, 0))
RIGHT, LEFT, DOWN, UP = range(4)
STATES, ACTIONS = SIDE * SIDE, len(MOVES)
SEEDS = (0, 1, 2)
BOUND = 0.1

COMMON: dict[str, Any] = {"hidden": (32, 32), "batch_size": 64}
DILO: dict[str, Any] = {
    **COMMON,
    "discount": DISCOUNT,
    "value_learning_rate": 3e-3,
    "policy_learning_rate": 3e-3,
    "target_rate": 0.05,
    # V reaches 2 / (1 - gamma) = 20, where the released 0.06 meets 200: the same range of exponents, rounded up.
    "tau": 0.25,
}
DISCRIMINATOR: dict[str, Any] = {
    "discount": DISCOUNT,
    "discriminator_learning_rate": 3e-3,
    "discriminator_passes": 160,
    "discriminator_batch": 100,
}


def transition_matrix() -> Array:
    """``P[s, a, s']``: the chosen move, or with probability `SLIP` a uniformly random one; walls hold."""
    matrix = np.zeros((STATES, ACTIONS, STATES))
    for state in range(STATES):
        for action in range(ACTIONS):
            for taken, (down, right) in enumerate(MOVES):
                row = min(max(state // SIDE + down, 0), SIDE - 1)
                column = min(max(state % SIDE + right, 0), SIDE - 1)
                matrix[state, action, row * SIDE + column] += (1.0 - SLIP) * (action == taken) + SLIP / ACTIONS
    return matrix


MATRIX = transition_matrix()
START = np.eye(STATES)[[0, 1, SIDE]].mean(0)


def expert_policy() -> Array:
    """Right to the last column, then down to the corner, and stay."""
    return np.eye(ACTIONS)[[DOWN if state % SIDE == SIDE - 1 else RIGHT for state in range(STATES)]]


def behaviour_policy() -> Array:
    """A stumble that prefers left and up."""
    policy = np.zeros((STATES, ACTIONS))
    policy[:, [RIGHT, LEFT, DOWN, UP]] = [0.2, 0.3, 0.2, 0.3]
    return policy


def visitation(policy: Array) -> Array:
    """``d = (1 - gamma) (I - gamma P_pi^T)^-1 d_0``, the discounted state visitation."""
    under_policy = np.einsum("sa,sat->st", policy, MATRIX)
    solution: Array = np.linalg.solve(np.eye(STATES) - DISCOUNT * under_policy.T, (1.0 - DISCOUNT) * START)
    return solution


def distance_to_expert(policy: Array) -> float:
    """Total variation between the policy's visitation and the expert's."""
    return float(np.abs(visitation(policy) - visitation(expert_policy())).sum() / 2.0)


def roll_out(policy: Array, episodes: int, generator: np.random.Generator) -> Episodes:
    states, actions = [], []
    for _ in range(episodes):
        states.append(generator.choice(STATES, p=START))
        for _ in range(HORIZON):
            actions.append(generator.choice(ACTIONS, p=policy[states[-1]]))
            states.append(generator.choice(STATES, p=MATRIX[states[-1], actions[-1]]))
    return Episodes(
        observations=np.eye(STATES, dtype=np.float32)[states],
        actions=2.0 * np.eye(ACTIONS, dtype=np.float32)[actions] - 1.0,
        rewards=np.zeros(len(actions), np.float32),
        lengths=np.full(episodes, HORIZON),
        terminated=np.zeros(episodes, np.bool_),
    )


@cache
def data() -> tuple[Episodes, Episodes]:
    generator = np.random.default_rng(0)
    return roll_out(behaviour_policy(), 400, generator), roll_out(expert_policy(), 60, generator)


def trained_policies(name: str, steps: int, **overrides: Any) -> list[Array]:
    """Per seed, the policy that takes the largest component of the action vector."""
    method = registry.load_method(name)
    config = method.Config(**overrides)
    needs = method.needs(config)
    offline, expert = data()
    recipe = Recipe("random", offline.transitions, "expert", expert_trajectories=30, demonstration_rows=1000)
    seen = view(method, needs, mix(offline, expert, recipe, needs, HORIZON), CPU)
    trained = method(config, seen.shapes, SEEDS, CPU)
    for stage in trained.stages(seen.sizes):
        train(trained, stage, seen, SEEDS, steps if stage.steps is None else stage.steps)
    states = torch.from_numpy(seen.transform(np.eye(STATES, dtype=np.float32)))
    chosen = trained.act(states.expand(len(SEEDS), -1, -1)).argmax(-1).numpy()
    return [np.eye(ACTIONS)[choice] for choice in chosen]


def test_visitation_is_the_discounted_frequency_of_states() -> None:
    expected, distribution = np.zeros(STATES), START.copy()
    for step in range(400):
        expected += (1.0 - DISCOUNT) * DISCOUNT**step * distribution
        distribution = distribution @ np.einsum("sa,sat->st", behaviour_policy(), MATRIX)
    np.testing.assert_allclose(visitation(behaviour_policy()), expected, atol=1e-12)


def test_neither_chance_nor_the_behaviour_nor_a_clone_of_the_mix_comes_near_the_expert() -> None:
    assert distance_to_expert(np.full((STATES, ACTIONS), 1.0 / ACTIONS)) > 5.0 * BOUND
    assert distance_to_expert(behaviour_policy()) > 5.0 * BOUND
    for policy in trained_policies("bc", 400, loss="squared", learning_rate=3e-3, **COMMON):
        assert distance_to_expert(policy) > 5.0 * BOUND


@pytest.mark.slow
@pytest.mark.parametrize(
    "objective", [{}, {"conservatism": None, "policy": "gaussian"}], ids=["released", "paper-objective"]
)
def test_dilo_recovers_the_experts_visitation(objective: dict[str, Any]) -> None:
    distances = [distance_to_expert(policy) for policy in trained_policies("dilo", 800, **DILO, **objective)]
    assert max(distances) < BOUND, distances


@pytest.mark.slow
@pytest.mark.parametrize("frozen", [True, False], ids=["released", "repaired"])
def test_smodice_recovers_the_experts_visitation(frozen: bool) -> None:
    settings = {**COMMON, **DISCRIMINATOR, "batch_size": 256, "learning_rate": 1e-3, "freeze_first_layer": frozen}
    # Chosen for being clear of the bound in 12 seeds. With rate 2e-3 and 40 discriminator passes, one seed of the
    # released form was still at 0.38 after 1600 steps.
    distances = [distance_to_expert(policy) for policy in trained_policies("smodice", 1600, **settings)]
    assert max(distances) < BOUND, distances


@pytest.mark.slow
def test_oril_recovers_the_experts_visitation() -> None:
    settings = {**COMMON, **DISCRIMINATOR, "learning_rate": 3e-3, "target_rate": 0.05}
    distances = [distance_to_expert(policy) for policy in trained_policies("oril", 800, **settings)]
    assert max(distances) < BOUND, distances


def test_cloning_the_expert_with_its_actions_recovers_its_visitation() -> None:
    settings = {**COMMON, "loss": "squared", "learning_rate": 3e-3}
    distances = [distance_to_expert(policy) for policy in trained_policies("bc-expert", 400, **settings)]
    assert max(distances) < BOUND, distances
