from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
import references as ref
import torch
from method_helpers import (
    CPU,
    normal,
)

from lfobench.nn.networks import Adam, Network

SIZES = (6, 16, 12, 1)
SEEDS = (0, 1, 7)


def network(name: str = "value", **options: object) -> Network:
    return Network(name, SIZES, SEEDS, CPU, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("initialization", ["torch", "xavier"])
def test_networks_of_different_names_start_differently(initialization: str) -> None:
    names = ["value", "policy", "discriminator", "actor", "critic", "inverse dynamics"]
    flats = {name: network(name, initialization=initialization).flat for name in names}
    for first, second in combinations(names, 2):
        for seed in range(len(SEEDS)):
            used = flats[first][seed] != 0.0
            correlation = np.corrcoef(flats[first][seed][used].numpy(), flats[second][seed][used].numpy())[0, 1]
            assert abs(correlation) < 0.4, f"{first} and {second} start from the same numbers"


def test_seeds_and_heads_start_differently_and_repeat() -> None:
    twins = network(heads=2)
    assert len(torch.unique(twins.flat, dim=0)) == len(twins.flat)
    assert torch.equal(twins.flat, network(heads=2).flat)


def test_default_weights_and_biases_fill_the_range_of_a_torch_linear_layer() -> None:
    """nn.Linear: both uniform in +-1/sqrt(fan_in)."""
    wide = Network("value", (25, 400, 1), SEEDS, CPU)
    parameters = ref.unflatten(wide.flat[0].double().numpy(), (25, 400, 1))
    for layer, bound in ((parameters[0], 0.2), (parameters[1], 0.2), (parameters[2], 0.05)):
        assert 0.95 * bound < np.abs(layer).max() <= bound
        assert layer.std() == pytest.approx(bound / np.sqrt(3.0), rel=0.1)


@pytest.mark.parametrize("heads", [1, 2])
def test_outputs_are_those_of_every_seeds_and_heads_own_parameters(heads: int) -> None:
    built = network(heads=heads)
    inputs = normal(np.random.default_rng(1), len(SEEDS), 9, SIZES[0])
    outputs = built(inputs)
    assert outputs.shape == ((len(SEEDS), heads, 9, 1) if heads > 1 else (len(SEEDS), 9, 1))
    for seed in range(len(SEEDS)):
        for head in range(heads):
            parameters = ref.unflatten(built.flat[seed * heads + head].double().numpy(), SIZES)
            expected = ref.evaluate(parameters, inputs[seed].double().numpy())
            found = outputs[seed, head] if heads > 1 else outputs[seed]
            np.testing.assert_allclose(found.detach().numpy(), expected, atol=1e-6)
            if heads > 1:
                alone = built.head(head)(inputs)[seed]
                np.testing.assert_allclose(alone.detach().numpy(), expected, atol=1e-6)


def test_gradient_of_a_seeds_loss_is_zero_for_the_other_seeds_and_in_the_padding() -> None:
    built = network(heads=2)
    inputs = normal(np.random.default_rng(2), len(SEEDS), 9, SIZES[0])
    only_second = torch.tensor([0.0, 1.0, 0.0])
    gradient = built.gradient(built(inputs)[..., 0].mean((1, 2)) * only_second)
    used = sum(fan_in * fan_out + fan_out for fan_in, fan_out in pairwise(SIZES))
    assert (gradient[[0, 1, 4, 5]] == 0.0).all()
    assert (gradient[:, used:] == 0.0).all()
    for row in (2, 3):
        parameters = ref.unflatten(built.flat[row].double().numpy(), SIZES)
        expected = ref.pull_back(parameters, inputs[1].double().numpy(), np.full((9, 1), 1.0 / 18.0))
        np.testing.assert_allclose(gradient[row, :used].numpy(), ref.flatten(expected), atol=1e-6)


def test_a_copy_has_the_same_outputs_and_moves_only_when_told() -> None:
    built = network()
    copy = built.copy()
    inputs = normal(np.random.default_rng(3), len(SEEDS), 9, SIZES[0])
    before = copy(inputs).detach().clone()
    assert torch.equal(before, built(inputs))
    built.flat.add_(1.0)
    assert torch.equal(copy(inputs), before)
    start = copy.flat.clone()
    copy.follow(built, 0.25)
    torch.testing.assert_close(copy.flat, start + 0.25)
    copy.follow(built, 1.0)
    assert torch.equal(copy.flat, built.flat)


@pytest.mark.parametrize("decay", [0.0, 0.01])
@pytest.mark.parametrize("cosine", [None, 15])
def test_adam_agrees_with_the_reference(decay: float, cosine: int | None) -> None:
    """A cosine of 15 steps ends within the 25 of the test: the rate is then 0 and nothing moves."""
    generator = np.random.default_rng(4)
    flat = normal(generator, len(SEEDS), 64)
    expected, reference = [flat.double().numpy()], ref.AdamReference()
    adam = Adam(flat, 0.01, weight_decay=decay, cosine_steps=cosine)
    for step in range(25):
        gradient = normal(generator, *flat.shape)
        rate = 0.01 if cosine is None else 0.01 * (1.0 + np.cos(np.pi * min(step, cosine) / cosine)) / 2.0
        reference.step(expected, [gradient.double().numpy() + decay * expected[0]], rate)
        adam.step(gradient)
    np.testing.assert_allclose(flat.numpy(), expected[0], atol=2e-6)
    assert float(adam.live_tensors()["step"]) == 25.0
