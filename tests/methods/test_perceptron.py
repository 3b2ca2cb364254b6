"""Hand-written passes against torch's own operations; batched products against one entry after another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch
from method_helpers import normal
from torch import Tensor

from lfobench.nn import perceptron
from lfobench.nn.perceptron import Activation, Layout, Parameters, composed, differentiable, evaluated

SEEDS, HEADS, ROWS = 3, 2, 300


def parameters(sizes: tuple[int, ...], activation: Activation = "relu", frozen: int = 0) -> Parameters:
    used = Layout(sizes, 0, activation).used
    layout = Layout(sizes, used + 5, activation, HEADS, frozen)
    return Parameters(layout, 0.3 * normal(np.random.default_rng(0), SEEDS * HEADS, used + 5))


def inputs(width: int) -> Tensor:
    return normal(np.random.default_rng(1), SEEDS, ROWS, width)


def gradient_of(outputs: Tensor, leaf: Tensor, **options: Any) -> Tensor:
    weights = normal(np.random.default_rng(2), *outputs.shape)
    (gradient,) = torch.autograd.grad((weights * outputs.square()).sum(), leaf, **options)
    return gradient


@pytest.fixture(params=["one by one", "batched"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """How the leading axis is multiplied; the batched way is CUDA's, here run on a CPU."""
    if request.param == "batched":
        monkeypatch.setattr(perceptron, "batched", lambda tensor: True)
    yield request.param


@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("sizes", [(6, 32, 32, 1), (6, 32, 16, 4), (6, 3), (1, 8, 1)], ids=str)
@pytest.mark.parametrize("frozen", [0, 1])
def test_a_pass_is_what_torchs_operations_give(
    sizes: tuple[int, ...], activation: Activation, frozen: int, way: str
) -> None:
    built, given = parameters(sizes, activation, min(frozen, len(sizes) - 2)), inputs(sizes[0])
    expected = composed(built.layout, built.leaf, given)
    found = differentiable(built, given)
    assert found.shape == (SEEDS * HEADS, ROWS, sizes[-1])
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(evaluated(built, given), expected, rtol=1e-5, atol=1e-5)
    gradient = gradient_of(found, built.leaf)
    torch.testing.assert_close(gradient, gradient_of(expected, built.leaf), rtol=1e-4, atol=1e-3)
    assert (gradient[:, built.layout.used :] == 0.0).all()


def test_several_losses_of_one_pass_share_signals_and_have_their_own_gradients(way: str) -> None:
    built, given = parameters((6, 32, 32, 1)), inputs(6)
    kept = differentiable(built, given)
    losses = [kept.sum(), kept.square().sum(), kept[:, :7].exp().sum()]
    for index, loss in enumerate(losses):
        (found,) = torch.autograd.grad(loss, built.leaf, retain_graph=True)
        alone = composed(built.layout, built.leaf, given)
        other = [alone.sum(), alone.square().sum(), alone[:, :7].exp().sum()][index]
        (expected,) = torch.autograd.grad(other, built.leaf)
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-3)


def test_shared_signals_spare_products() -> None:
    """A second loss of one pass costs the weights' gradients and nothing more."""
    from torch.utils.flop_counter import FlopCounterMode

    built, given = parameters((6, 32, 32, 1)), inputs(6)
    outputs = differentiable(built, given)
    counts = []
    for _ in range(2):
        with FlopCounterMode(display=False) as counter:
            torch.autograd.grad(outputs.sum(), built.leaf, retain_graph=True)
        counts.append(counter.get_total_flops())
    weights = 2 * SEEDS * HEADS * ROWS * (6 * 32 + 32 * 32 + 32)
    assert counts == [weights + 2 * SEEDS * HEADS * ROWS * 32 * 32, weights]


def test_bf16_products_are_near_and_leave_float32_outside() -> None:
    """Eight bits of fraction in every product: a few percent of the largest output."""
    built, given = parameters((6, 32, 32, 1)), inputs(6)
    expected = composed(built.layout, built.leaf, given)
    with torch.autocast("cpu", torch.bfloat16, cache_enabled=False):
        found = differentiable(built, given)
        without = evaluated(built, given)
    assert found.dtype == without.dtype == torch.float32
    gradient = gradient_of(found, built.leaf)
    assert gradient.dtype == torch.float32
    exact = gradient_of(expected, built.leaf)
    for near, true in ((found, expected), (without, expected), (gradient, exact)):
        error = (near - true).abs().max() / true.abs().max()
        assert 0.0 < error < 0.06, "rounded, and only rounded"
