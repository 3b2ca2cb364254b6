from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import references as ref
import torch
from method_helpers import (
    NO_BATCH,
    GivenRandomness,
    assert_gradients_agree,
    build,
    first_gradient,
    make_batch,
    normal,
    parameters_of,
    randomize,
    rows_of,
)

from lfobench.contract.method import Batch, Shapes
from lfobench.engine.state import live_tensors
from methods.oril import Oril

SHAPES = Shapes(observation=5, action=3)
HIDDEN = (9, 8)
DISCRIMINATOR = (SHAPES.observation, *HIDDEN, 1)
ACTOR = (SHAPES.observation, *HIDDEN, SHAPES.action)
CRITIC = (SHAPES.observation + SHAPES.action, *HIDDEN, 1)
SEEDS = (4, 9)
ROWS = 40
# Wide enough that both the noise bound (2.5 standard deviations) and the action bound are met.
NOISE = 2.0 * normal(np.random.default_rng(99), len(SEEDS), ROWS, SHAPES.action)


def make(**overrides: Any) -> Oril:
    """Targets that have nothing in common with the online networks, so that a mix-up shows."""
    oril: Oril = build(Oril, SHAPES, SEEDS, **{"hidden": HIDDEN, **overrides})
    for name, sizes in (("critic", CRITIC), ("critic_target", CRITIC), ("actor", ACTOR), ("actor_target", ACTOR)):
        randomize(oril, name, sizes, 1.0)
    return oril


def offline_batch(seed: int, ended: float = 0.3) -> Batch:
    needs = Oril.needs(Oril.Config())
    return make_batch(needs.offline, SHAPES, len(SEEDS), ROWS, np.random.default_rng(seed), ended)


def update(oril: Oril, offline: Batch, step: int) -> None:
    oril.update("policy", offline, NO_BATCH, GivenRandomness(step % oril.config.policy_delay, normal=NOISE))


def critics_of(oril: Oril, name: str, seed: int) -> list[ref.Parameters]:
    return [parameters_of(oril, name, CRITIC, 2 * seed + head) for head in (0, 1)]


@pytest.mark.parametrize("name", ["actor", "critic"])
def test_targets_start_as_copies_with_storage_of_their_own(name: str) -> None:
    state = live_tensors(build(Oril, SHAPES, SEEDS, hidden=HIDDEN))
    assert torch.equal(state[name], state[f"{name}_target"])
    assert state[name].data_ptr() != state[f"{name}_target"].data_ptr()


@pytest.mark.parametrize("ended", [0.0, 0.3, 1.0])
def test_critic_gradient(ended: float) -> None:
    oril, offline = make(), offline_batch(1, ended)
    expected = []
    for seed in range(len(SEEDS)):
        rows = rows_of(offline, seed)
        discriminator = parameters_of(oril, "discriminator", DISCRIMINATOR, seed)
        reward = ref.evaluate(discriminator, rows["observation"], np.tanh)[:, 0]
        actor = parameters_of(oril, "actor_target", ACTOR, seed)
        noise = NOISE[seed].double().numpy()
        target = ref.oril_target(actor, critics_of(oril, "critic_target", seed), reward, rows, noise)
        expected += ref.oril_critic_gradients(critics_of(oril, "critic", seed), rows, target)
    update(oril, offline, step=0)
    for row, gradient in enumerate(expected):
        assert_gradients_agree(first_gradient(oril, "critic_optimizer", CRITIC, row), gradient)


def test_actor_gradient_uses_the_first_critic_after_its_step() -> None:
    oril, offline = make(learning_rate=1e-2), offline_batch(2)
    actors = [parameters_of(oril, "actor", ACTOR, seed) for seed in range(len(SEEDS))]
    update(oril, offline, step=1)
    for seed, actor in enumerate(actors):
        rows = rows_of(offline, seed)
        critic = critics_of(oril, "critic", seed)[0]
        scale = ref.oril_scale(actor, critic, rows)

        def loss(
            trial: ref.Parameters, critic: ref.Parameters = critic, rows: ref.Rows = rows, scale: float = scale
        ) -> float:
            return ref.oril_actor_loss(trial, critic, rows, scale)

        expected = ref.numerical_gradient(loss, actor)
        assert_gradients_agree(first_gradient(oril, "actor_optimizer", ACTOR, seed), expected)


def test_actor_and_targets_move_every_second_step_only() -> None:
    oril = make()
    slow = ("actor", "actor_target", "critic_target")
    for step in range(6):
        before = {name: tensor.clone() for name, tensor in live_tensors(oril).items()}
        update(oril, offline_batch(step), step)
        assert not torch.equal(live_tensors(oril)["critic"], before["critic"])
        for name in slow:
            assert torch.equal(live_tensors(oril)[name], before[name]) == (step % 2 == 0), (name, step)


def test_targets_follow_the_updated_networks_at_their_rate() -> None:
    oril = make(learning_rate=1e-2)
    before = {name: live_tensors(oril)[name].double().clone() for name in ("actor_target", "critic_target")}
    update(oril, offline_batch(3), step=1)
    for name, old in before.items():
        online = live_tensors(oril)[name.removesuffix("_target")].double()
        torch.testing.assert_close(
            live_tensors(oril)[name].double(), old + 0.005 * (online - old), rtol=1e-6, atol=1e-7
        )


def test_actor_loss_does_not_train_the_critic() -> None:
    first, second = make(), make(value_weight=0.0)
    for oril in (first, second):
        for step in range(2):
            update(oril, offline_batch(4), step)
    assert torch.equal(live_tensors(first)["critic"], live_tensors(second)["critic"])
    assert not torch.equal(live_tensors(first)["actor"], live_tensors(second)["actor"])


def test_acts_by_the_tanh_of_the_actor() -> None:
    oril = make()
    observation = normal(np.random.default_rng(5), len(SEEDS), 10, SHAPES.observation)
    action = oril.act(observation).detach()
    for seed in range(len(SEEDS)):
        actor = parameters_of(oril, "actor", ACTOR, seed)
        expected = np.tanh(ref.evaluate(actor, observation[seed].double().numpy()))
        np.testing.assert_allclose(action[seed].numpy(), expected, atol=1e-6)
