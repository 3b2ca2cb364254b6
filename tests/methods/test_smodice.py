from __future__ import annotations

from itertools import pairwise
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
from methods.smodice import Smodice

SHAPES = Shapes(observation=5, action=3)
HIDDEN = (9, 8)
VALUE = (SHAPES.observation, *HIDDEN, 1)
POLICY = (SHAPES.observation, *HIDDEN, 2 * SHAPES.action)
SEEDS = (4, 9)
ROWS = 40
# Narrow, because 1 - a^2 + 1e-6 of a saturated sample is known to float32 to a few percent only.
NOISE = 0.4 * normal(np.random.default_rng(99), len(SEEDS), ROWS, SHAPES.action)
RANDOM = GivenRandomness(normal=NOISE)

divergences = pytest.mark.parametrize("divergence", ["kl", "chi2"])


def make(**overrides: Any) -> Smodice:
    smodice: Smodice = build(Smodice, SHAPES, SEEDS, **{"hidden": HIDDEN, **overrides})
    randomize(smodice, "value", VALUE, 0.8)
    randomize(smodice, "discriminator", VALUE, 0.8)
    randomize(smodice, "policy", POLICY, 0.7)
    return smodice


def offline_batch(seed: int, ended: float = 0.3) -> Batch:
    needs = Smodice.needs(Smodice.Config())
    return make_batch(needs.offline, SHAPES, len(SEEDS), ROWS, np.random.default_rng(seed), ended)


def reward_of(smodice: Smodice, rows: ref.Rows, seed: int) -> ref.Array:
    parameters = parameters_of(smodice, "discriminator", VALUE, seed)
    return ref.evaluate(parameters, rows["observation"], np.tanh)[:, 0]


@divergences
@pytest.mark.parametrize("ended", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("decay", [0.0, 1e-4, 0.1])
def test_value_gradient(divergence: str, ended: float, decay: float) -> None:
    """L2 decay is part of the gradient that enters Adam's moments."""
    smodice = make(divergence=divergence, value_weight_decay=decay)
    offline = offline_batch(1, ended)
    before = [parameters_of(smodice, "value", VALUE, seed) for seed in range(len(SEEDS))]
    smodice.update("policy", offline, NO_BATCH, RANDOM)
    for seed, value in enumerate(before):
        rows = rows_of(offline, seed)
        loss = ref.smodice_value_gradient(value, reward_of(smodice, rows, seed), rows, 0.99, divergence)
        expected = [gradient + decay * parameter for gradient, parameter in zip(loss, value, strict=True)]
        assert_gradients_agree(first_gradient(smodice, "value_optimizer", VALUE, seed), expected)


@divergences
def test_listed_value_gradient_is_the_derivative_of_the_loss(divergence: str) -> None:
    smodice = make()
    rows = rows_of(offline_batch(2), 0)
    value, reward = parameters_of(smodice, "value", VALUE, 0), reward_of(smodice, rows, 0)

    def loss(trial: ref.Parameters) -> float:
        e = ref.smodice_residual(trial, reward, rows, 0.99)
        conjugate = np.log(np.exp(e).mean()) if divergence == "kl" else (e**2 / 2.0 + e).mean()
        return float(0.01 * ref.evaluate(trial, rows["initial_observation"]).mean() + conjugate)

    listed = ref.smodice_value_gradient(value, reward, rows, 0.99, divergence)
    assert_gradients_agree(listed, ref.numerical_gradient(loss, value), tolerance=1e-6)


@divergences
def test_value_loss(divergence: str) -> None:
    smodice = make(divergence=divergence)
    offline = offline_batch(3)
    expected = []
    for seed in range(len(SEEDS)):
        rows = rows_of(offline, seed)
        value = parameters_of(smodice, "value", VALUE, seed)
        e = ref.smodice_residual(value, reward_of(smodice, rows, seed), rows, 0.99)
        conjugate = np.log(np.exp(e).mean()) if divergence == "kl" else (e**2 / 2.0 + e).mean()
        expected.append(0.01 * ref.evaluate(value, rows["initial_observation"]).mean() + conjugate)
    measured = smodice.update("policy", offline, NO_BATCH, RANDOM)["value_loss"]
    np.testing.assert_allclose(measured.numpy(), expected, rtol=1e-5)


def test_chi2_derivative_is_not_truncated_although_its_weight_is() -> None:
    smodice = make(divergence="chi2")
    residual = torch.linspace(-4.0, 4.0, 81).repeat(len(SEEDS), 1).requires_grad_()
    loss = smodice.value_loss(residual, torch.zeros(len(SEEDS), 1))
    (slope,) = torch.autograd.grad(loss.sum(), residual)
    torch.testing.assert_close(slope * residual.shape[1], residual + 1.0)
    weight = smodice.policy_weights(residual.detach())
    torch.testing.assert_close(weight, torch.clamp(residual.detach() + 1.0, min=0.0))
    assert (weight == 0.0).any()


def test_kl_weight_is_the_plain_exponential() -> None:
    residual = torch.tensor([[-5.0, 0.0, 2.0, 6.0]] * len(SEEDS))
    torch.testing.assert_close(make().policy_weights(residual), residual.exp())


@divergences
@pytest.mark.parametrize("entropy", [True, False], ids=["entropy-constrained", "likelihood"])
def test_policy_and_temperature_gradients(divergence: str, entropy: bool) -> None:
    smodice = make(divergence=divergence, entropy_constraint=entropy, learning_rate=1e-2)
    live_tensors(smodice)["policy.log_temperature"][:, 0] = torch.tensor([-0.7, 0.4])
    offline = offline_batch(4)
    policies = [parameters_of(smodice, "policy", POLICY, seed) for seed in range(len(SEEDS))]
    values = [parameters_of(smodice, "value", VALUE, seed) for seed in range(len(SEEDS))]
    metrics = smodice.update("policy", offline, NO_BATCH, RANDOM if entropy else GivenRandomness())
    for seed, policy in enumerate(policies):
        rows = rows_of(offline, seed)
        # The weights come from the value before its step.
        e = ref.smodice_residual(values[seed], reward_of(smodice, rows, seed), rows, 0.99)
        weight = np.exp(e) if divergence == "kl" else np.maximum(0.0, e + 1.0)
        noise = NOISE[seed].double().numpy() if entropy else None
        temperature = (-0.7, 0.4)[seed]

        def loss(
            trial: ref.Parameters,
            rows: ref.Rows = rows,
            weight: ref.Array = weight,
            temperature: float = temperature,
            noise: ref.Array | None = noise,
        ) -> float:
            return ref.tanh_gaussian_loss(trial, rows, weight, temperature, noise)

        expected = ref.numerical_gradient(loss, policy)
        assert_gradients_agree(first_gradient(smodice, "policy.optimizer", POLICY, seed), expected, tolerance=1e-4)
        measured = live_tensors(smodice)["policy.temperature_optimizer.exp_avg"][seed] * 10.0
        assert (measured[1:] == 0.0).all()
        if noise is None:
            assert measured[0].item() == 0.0
            continue
        # L_l = -l (mean log pi(a~|s) + H), H = -dim(a).
        negative_entropy = ref.negative_entropy(policy, rows["observation"], noise)
        assert measured[0].item() == pytest.approx(-(negative_entropy - SHAPES.action), rel=1e-4)
        assert metrics["entropy"][seed].item() == pytest.approx(-negative_entropy, rel=1e-4)


def test_policy_gradient_through_saturated_means_and_log_stds() -> None:
    smodice = make(entropy_constraint=False)
    randomize(smodice, "policy", POLICY, 2.0)
    offline = offline_batch(5)
    policies = [parameters_of(smodice, "policy", POLICY, seed) for seed in range(len(SEEDS))]
    clamped = []
    values = [parameters_of(smodice, "value", VALUE, seed) for seed in range(len(SEEDS))]
    smodice.update("policy", offline, NO_BATCH, GivenRandomness())
    for seed, policy in enumerate(policies):
        rows = rows_of(offline, seed)
        weight = np.exp(ref.smodice_residual(values[seed], reward_of(smodice, rows, seed), rows, 0.99))
        mean, log_std = np.split(ref.evaluate(policy, rows["observation"]), 2, axis=-1)
        clamped.append([(np.abs(mean) > 7.24).mean(), (log_std < -5.0).mean(), (log_std > 2.0).mean()])

        def loss(trial: ref.Parameters, rows: ref.Rows = rows, weight: ref.Array = weight) -> float:
            return ref.tanh_gaussian_loss(trial, rows, weight, 0.0, None)

        expected = ref.numerical_gradient(loss, policy)
        assert_gradients_agree(first_gradient(smodice, "policy.optimizer", POLICY, seed), expected, tolerance=1e-4)
    assert np.array(clamped).min() > 0.0, "every clamp must have been met"


def test_data_actions_on_the_box_have_the_likelihood_of_the_margin() -> None:
    """float32 knows 1 - 1e-6 to about 6e-8, so the pre-squash value to about 3%."""
    smodice = make()
    action = torch.tensor([[[1.0, -1.0, 0.5]]] * len(SEEDS))
    mean, log_std = torch.zeros_like(action), torch.zeros_like(action)
    measured = smodice.policy.log_likelihood(action, mean, log_std)
    inside = np.clip(np.array([1.0, -1.0, 0.5]), -(1.0 - 1e-6), 1.0 - 1e-6)
    expected = ref.squashed_log_density(np.arctanh(inside), inside, np.zeros(3), np.zeros(3))
    assert torch.isfinite(measured).all()
    np.testing.assert_allclose(measured.numpy(), np.full((len(SEEDS), 1), expected), rtol=0.02)


def test_log_temperature_starts_at_zero_and_acts_before_its_step() -> None:
    smodice = make(learning_rate=0.5)
    assert (live_tensors(smodice)["policy.log_temperature"] == 0.0).all()
    offline = offline_batch(6)
    smodice.update("policy", offline, NO_BATCH, RANDOM)
    moved = live_tensors(smodice)["policy.log_temperature"][:, 0]
    assert (moved.abs() > 0.4).all()
    assert (live_tensors(smodice)["policy.log_temperature"][:, 1:] == 0.0).all()


def test_acts_by_the_tanh_of_the_clamped_mean() -> None:
    smodice = make()
    randomize(smodice, "policy", POLICY, 3.0)
    observation = normal(np.random.default_rng(7), len(SEEDS), 10, SHAPES.observation)
    action = smodice.act(observation).detach()
    for seed in range(len(SEEDS)):
        mean, _ = ref.tanh_gaussian(parameters_of(smodice, "policy", POLICY, seed), observation[seed].double().numpy())
        np.testing.assert_allclose(action[seed].numpy(), np.tanh(mean), atol=1e-5)


def test_value_weights_start_in_the_glorot_range_with_zero_biases() -> None:
    assert_glorot("value", outputs=1, heads=1)


def test_policy_weights_start_in_the_glorot_range_of_separate_mean_and_std_layers() -> None:
    assert_glorot("policy", outputs=2 * SHAPES.action, heads=2)


def assert_glorot(name: str, outputs: int, heads: int) -> None:
    smodice: Smodice = build(Smodice, SHAPES, SEEDS, hidden=(64, 64))
    sizes = (SHAPES.observation, 64, 64, outputs)
    for seed in range(len(SEEDS)):
        parameters = parameters_of(smodice, name, sizes, seed)
        for index, (fan_in, fan_out) in enumerate(pairwise(sizes)):
            width = fan_out // heads if index == 2 else fan_out
            bound = np.sqrt(6.0 / (fan_in + width))
            weight, bias = parameters[2 * index], parameters[2 * index + 1]
            assert np.abs(weight).max() <= bound
            assert np.abs(weight).max() > 0.9 * bound
            assert (bias == 0.0).all()
