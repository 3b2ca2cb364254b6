from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import references as ref
import torch
from helpers_engine import batches_at
from method_helpers import (
    NO_BATCH,
    GivenRandomness,
    assert_gradients_agree,
    build,
    first_gradient,
    flat_of,
    make_batch,
    normal,
    parameters_of,
    random_view,
    randomize,
    rows_of,
    train,
    uniform,
)

from lfobench.contract.method import Method, Shapes, Sizes
from lfobench.engine.batches import StageSampler
from lfobench.engine.state import live_tensors
from lfobench.randomness import Randomness
from methods.oril import Oril
from methods.smodice import Smodice

SHAPES = Shapes(observation=5, action=3)
HIDDEN = (9, 8)
SIZES = (SHAPES.observation, *HIDDEN, 1)
SEEDS = (4, 9)
STAGE = "discriminator"
FIRST_LAYER = SHAPES.observation * HIDDEN[0] + HIDDEN[0]

both_methods = pytest.mark.parametrize("method", [Smodice, Oril], ids=["smodice", "oril"])


@both_methods
@pytest.mark.parametrize("penalty", [0.0, 10.0])
@pytest.mark.parametrize("gain", [0.4, 1.5])
def test_gradient_of_classification_and_penalty(method: type[Method], penalty: float, gain: float) -> None:
    built = build(method, SHAPES, SEEDS, hidden=HIDDEN, freeze_first_layer=False, gradient_penalty=penalty)
    randomize(built, STAGE, SIZES, gain)
    before = [parameters_of(built, STAGE, SIZES, seed) for seed in range(len(SEEDS))]
    generator = np.random.default_rng(1)
    expert = make_batch(("observation",), SHAPES, len(SEEDS), 24, generator)
    offline = make_batch(("observation",), SHAPES, len(SEEDS), 32, generator)
    fraction = uniform(generator, len(SEEDS), 24, 1)
    metrics = built.update(STAGE, offline, expert, GivenRandomness(uniform=fraction))
    for seed, parameters in enumerate(before):
        states = rows_of(expert, seed)["observation"]
        # The offline batch is cut to the expert rows of a short batch.
        others = rows_of(offline, seed)["observation"][:24]
        mixing = fraction[seed].double().numpy()

        def loss(
            trial: ref.Parameters, states: ref.Array = states, others: ref.Array = others, mixing: ref.Array = mixing
        ) -> float:
            return ref.discriminator_loss(trial, states, others, mixing, penalty)

        expected = ref.numerical_gradient(loss, parameters)
        assert_gradients_agree(first_gradient(built, f"{STAGE}.optimizer", SIZES, seed), expected)
        measured = metrics["discriminator_loss"][seed].item() + penalty * metrics["gradient_penalty"][seed].item()
        assert measured == pytest.approx(loss(parameters), rel=1e-5)


@both_methods
def test_released_optimiser_never_touches_the_first_layer_and_the_papers_does(method: type[Method]) -> None:
    for preset, frozen in (("released", True), ("paper", False)):
        built = build(method, SHAPES, SEEDS, **{**method.presets[preset], "hidden": HIDDEN, "discriminator_batch": 16})
        view = random_view(method.needs(built.config), SHAPES, 100, 40)
        before = flat_of(built, STAGE).clone()
        train(built, built.stages(view.sizes)[0], view, SEEDS, 30)
        changed = flat_of(built, STAGE) != before
        used = sum(i * o + o for i, o in pairwise(SIZES))
        assert changed[:, :FIRST_LAYER].any() == (not frozen)
        assert changed[:, FIRST_LAYER:used].float().mean() > 0.99


@both_methods
def test_frozen_first_layer_leaves_the_gradient_of_the_rest_unchanged(method: type[Method]) -> None:
    generator = np.random.default_rng(2)
    batch = make_batch(("observation",), SHAPES, len(SEEDS), 16, generator)
    other = make_batch(("observation",), SHAPES, len(SEEDS), 16, generator)
    fraction = uniform(generator, len(SEEDS), 16, 1)
    moments = []
    for frozen in (True, False):
        built = build(method, SHAPES, SEEDS, hidden=HIDDEN, freeze_first_layer=frozen)
        built.update(STAGE, other, batch, GivenRandomness(uniform=fraction))
        moments.append(live_tensors(built)[f"{STAGE}.optimizer.exp_avg"].clone())
    assert (moments[0][:, :FIRST_LAYER] == 0.0).all()
    assert (moments[1][:, :FIRST_LAYER] != 0.0).any()
    torch.testing.assert_close(moments[0][:, FIRST_LAYER:], moments[1][:, FIRST_LAYER:], rtol=1e-6, atol=1e-8)


@both_methods
def test_a_thousand_expert_rows_make_4000_released_steps_with_a_short_last_batch_per_pass(method: type[Method]) -> None:
    built = build(method, SHAPES, SEEDS, hidden=HIDDEN)
    stage, main = built.stages(Sizes(offline=5000, expert=1000))
    assert (stage.name, stage.steps, stage.offline_batch, stage.expert_batch) == (STAGE, 4000, 256, 256)
    assert main.steps is None
    view = random_view(method.needs(built.config), SHAPES, 5000, 1000)
    sampler = StageSampler(view, stage, Randomness(SEEDS))
    passes = [
        torch.cat([batches_at(sampler, step)[1]["observation"] for step in range(first, first + 4)], 1)
        for first in (0, 4)
    ]
    assert [batches_at(sampler, step)[1]["observation"].shape[1] for step in range(5)] == [256, 256, 256, 232, 256]
    for seed in range(len(SEEDS)):
        assert len(torch.unique(passes[0][seed], dim=0)) == 1000, "a pass visits every expert state once"
    assert not torch.equal(passes[0], passes[1]), "every pass has an order of its own"


@both_methods
def test_discriminator_stays_as_it_is_in_the_main_stage(method: type[Method]) -> None:
    built = build(method, SHAPES, SEEDS, hidden=HIDDEN, batch_size=16)
    view = random_view(method.needs(built.config), SHAPES, 100, 40)
    before = {name: tensor.clone() for name, tensor in live_tensors(built).items() if name.startswith(STAGE)}
    train(built, built.stages(view.sizes)[-1], view, SEEDS, 4)
    assert all(torch.equal(live_tensors(built)[name], tensor) for name, tensor in before.items())


def test_discriminator_learns_to_tell_apart_and_gives_expert_states_the_larger_reward() -> None:
    built = build(Smodice, SHAPES, SEEDS, hidden=(32, 32), discriminator_learning_rate=2e-3)
    generator = np.random.default_rng(3)
    shift = torch.tensor([1.5, 0.0, 0.0, 0.0, 0.0])
    for _ in range(200):
        expert = normal(generator, len(SEEDS), 64, 5) + shift
        offline = normal(generator, len(SEEDS), 64, 5) - shift
        fraction = uniform(generator, len(SEEDS), 64, 1)
        built.update(STAGE, {"observation": offline}, {"observation": expert}, GivenRandomness(uniform=fraction))
    reward = built.discriminator.reward(torch.stack([shift, -shift]).expand(len(SEEDS), 2, 5))
    # The penalty asks for slopes of 1, and the two points are 3 apart.
    difference = reward[:, 0] - reward[:, 1]
    assert (difference > 1.0).all()
    assert (difference < 4.0).all()


def test_reward_is_the_raw_logit_however_saturated() -> None:
    built = build(Smodice, SHAPES, SEEDS, hidden=HIDDEN)
    observation = normal(np.random.default_rng(4), len(SEEDS), 12, SHAPES.observation)
    for gain in (0.5, 20.0):
        randomize(built, STAGE, SIZES, gain)
        reward = built.discriminator.reward(observation)
        for seed in range(len(SEEDS)):
            parameters = parameters_of(built, STAGE, SIZES, seed)
            logit = ref.evaluate(parameters, observation[seed].double().numpy(), np.tanh)[:, 0]
            np.testing.assert_allclose(reward[seed].numpy(), logit, rtol=1e-4, atol=1e-5 * gain)
    assert reward.abs().max() > 20.0, "beyond what log sigma(D) - log(1 - sigma(D)) can express in float32"


def test_no_batch_is_needed_beside_the_one_of_the_stage() -> None:
    built = build(Oril, SHAPES, SEEDS, hidden=HIDDEN)
    offline = make_batch(Oril.needs(built.config).offline, SHAPES, len(SEEDS), 8, np.random.default_rng(5))
    noise = torch.zeros(len(SEEDS), 8, SHAPES.action)
    assert torch.isfinite(built.update("policy", offline, NO_BATCH, GivenRandomness(normal=noise))["critic_loss"]).all()
