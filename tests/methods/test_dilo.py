from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import references as ref
import torch
from method_helpers import (
    CPU,
    GivenRandomness,
    assert_gradients_agree,
    build,
    first_gradient,
    make_batch,
    normal,
    parameters_of,
    randomize,
    rows_of,
    set_output,
)
from torch import Tensor

from lfobench.contract.method import Batch, Shapes
from lfobench.engine.state import live_tensors
from methods.dilo import Dilo, DiloConfig, conjugate

SHAPES = Shapes(observation=5, action=3)
HIDDEN = (16, 12)
VALUE = (2 * SHAPES.observation, *HIDDEN, 1)
POLICY = (SHAPES.observation, *HIDDEN, SHAPES.action)
ROWS = 48
SEEDS = (4, 9)
RANDOM = GivenRandomness()


def make(preset: str, **overrides: Any) -> Dilo:
    """Small networks with values of several units, so that both branches of phi and the weight cap are met."""
    dilo: Dilo = build(Dilo, SHAPES, SEEDS, **{**Dilo.presets[preset], "hidden": HIDDEN, **overrides})  # type: ignore[index]
    randomize(dilo, "value", VALUE, 1.5)
    dilo.target.flat.copy_(dilo.value.flat)
    return dilo


def batches(generator: np.random.Generator, ended: float = 0.3) -> tuple[Batch, Batch]:
    needs = Dilo.needs(DiloConfig())
    return (
        make_batch(needs.offline, SHAPES, len(SEEDS), ROWS, generator, ended),
        make_batch(needs.expert, SHAPES, len(SEEDS), ROWS, generator, ended),
    )


def heads_of(dilo: Dilo, name: str, seed: int) -> list[ref.Parameters]:
    return [parameters_of(dilo, name, VALUE, 2 * seed + head) for head in (0, 1)]


def log_std_of(dilo: Dilo, seed: int) -> ref.Array:
    state = live_tensors(dilo)
    if "policy.log_std" not in state:
        return np.zeros(SHAPES.action)
    return state["policy.log_std"][seed, : SHAPES.action].double().numpy()


def reference_of(dilo: Dilo, seed: int) -> ref.DiloReference:
    policy = parameters_of(dilo, "policy", POLICY, seed)
    return ref.DiloReference(
        heads_of(dilo, "value", seed), policy, log_std_of(dilo, seed), ref.constants_of(dilo.config)
    )


# --- the conjugate ----------------------------------------------------------------------------------------------


def test_phi_at_the_points_of_the_parity_checklist() -> None:
    y = torch.tensor([0.0, 2.0, -2.0, -5.0], dtype=torch.float64)
    assert conjugate(y).tolist() == [0.0, 3.0, -1.0, -1.0]


def test_phi_minus_y_is_nonnegative_and_zero_only_at_zero() -> None:
    y = torch.linspace(-8.0, 8.0, 1601, dtype=torch.float64)
    gap = conjugate(y) - y
    assert (gap >= 0.0).all()
    assert gap[y.abs() < 1e-12].abs().max() < 1e-15
    assert (gap[y.abs() > 1e-3] > 0.0).all()


def test_slope_of_phi_is_the_truncated_weight_and_of_phi_minus_y_half_y_or_minus_one() -> None:
    y = torch.linspace(-8.0, 8.0, 1601, dtype=torch.float64).requires_grad_()
    (slope,) = torch.autograd.grad(conjugate(y).sum(), y, retain_graph=True)
    (gap_slope,) = torch.autograd.grad((conjugate(y) - y).sum(), y)
    values = y.detach()
    torch.testing.assert_close(slope, torch.clamp(values / 2.0 + 1.0, min=0.0), rtol=0.0, atol=1e-12)
    below = values < -2.0
    assert (gap_slope[below] == -1.0).all()
    torch.testing.assert_close(gap_slope[~below], values[~below] / 2.0, rtol=0.0, atol=1e-12)


# --- the reference against itself -------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", ["released", "paper"])
def test_listed_cotangents_are_the_derivatives_of_the_losses(preset: str) -> None:
    """Ties the two forms of 3.1 together, so that the tests below check the method against the loss itself."""
    dilo = make(preset)
    offline, expert = batches(np.random.default_rng(1))
    rows_o, rows_e = rows_of(offline, 0), rows_of(expert, 0)
    constants = ref.constants_of(dilo.config)
    heads, targets = heads_of(dilo, "value", 0), heads_of(dilo, "target", 0)
    listed = ref.dilo_gradients(heads, targets, rows_o, rows_e, constants)
    for term, gradient in enumerate((listed.linear, listed.forward, listed.backward)):

        def loss(head: ref.Parameters, term: int = term) -> float:
            return ref.dilo_losses([head, heads[1]], targets, rows_o, rows_e, constants)[term]

        numerical = ref.numerical_gradient(loss, heads[0])
        assert_gradients_agree(gradient[0], numerical, tolerance=1e-6)


# --- gradients --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", ["released", "paper"])
@pytest.mark.parametrize("ended", [0.0, 0.3, 1.0])
def test_gradients_of_the_three_value_losses(preset: str, ended: float, monkeypatch: pytest.MonkeyPatch) -> None:
    dilo = make(preset)
    offline, expert = batches(np.random.default_rng(2), ended)
    expected = [
        ref.dilo_gradients(
            heads_of(dilo, "value", seed),
            heads_of(dilo, "target", seed),
            rows_of(offline, seed),
            rows_of(expert, seed),
            ref.constants_of(dilo.config),
        )
        for seed in range(len(SEEDS))
    ]
    terms: list[tuple[Tensor, ...]] = []
    combine = dilo.orthogonal_sum

    def recording(*gradients: Tensor) -> Tensor:
        terms.append(gradients)
        return combine(*gradients)

    monkeypatch.setattr(dilo, "orthogonal_sum", recording)
    dilo.update("policy", offline, expert, RANDOM)
    for seed, gradients in enumerate(expected):
        combination = ref.dilo_combination(gradients)
        for head in (0, 1):
            row = 2 * seed + head
            for term, wanted in zip(terms[0], (gradients.linear, gradients.forward, gradients.backward), strict=True):
                assert_gradients_agree(ref.unflatten(term[row].double().numpy(), VALUE), wanted[head])
            assert_gradients_agree(first_gradient(dilo, "value_optimizer", VALUE, row), combination[head])


def test_losses_are_those_of_the_definition() -> None:
    dilo = make("released")
    offline, expert = batches(np.random.default_rng(3))
    expected = [
        ref.dilo_losses(
            heads_of(dilo, "value", seed),
            heads_of(dilo, "target", seed),
            rows_of(offline, seed),
            rows_of(expert, seed),
            ref.constants_of(dilo.config),
        )
        for seed in range(len(SEEDS))
    ]
    metrics = dilo.update("policy", offline, expert, RANDOM)
    for seed, (_, forward, backward) in enumerate(expected):
        assert metrics["forward_loss"][seed].item() == pytest.approx(forward, rel=1e-5)
        assert metrics["backward_loss"][seed].item() == pytest.approx(backward, rel=1e-5)


@pytest.mark.parametrize("preset", ["released", "paper"])
def test_policy_gradient_uses_the_value_after_its_step(preset: str) -> None:
    dilo = make(preset, value_learning_rate=1e-2)
    offline, expert = batches(np.random.default_rng(4))
    constants = ref.constants_of(dilo.config)
    policies = [parameters_of(dilo, "policy", POLICY, seed) for seed in range(len(SEEDS))]
    before = [ref.dilo_weights(heads_of(dilo, "value", s), rows_of(offline, s), constants) for s in range(len(SEEDS))]
    dilo.update("policy", offline, expert, RANDOM)
    for seed, policy in enumerate(policies):
        rows = rows_of(offline, seed)
        weight = ref.dilo_weights(heads_of(dilo, "value", seed), rows, constants)
        assert np.abs(weight / before[seed] - 1.0).max() > 0.001
        if preset == "released":
            expected = ref.regression_gradient(policy, rows, weight)
        else:
            expected, log_std = ref.likelihood_gradient(policy, np.zeros(SHAPES.action), rows, weight)
            measured = (
                live_tensors(dilo)["policy.log_std_optimizer.exp_avg"][seed, : SHAPES.action].double().numpy() * 10.0
            )
            np.testing.assert_allclose(measured, log_std, rtol=1e-3)
        assert_gradients_agree(first_gradient(dilo, "policy.optimizer", POLICY, seed), expected, tolerance=2e-4)


# --- the orthogonal combination ---------------------------------------------------------------------------------


def test_projected_backward_gradient_is_orthogonal_to_the_forward_one_over_both_heads() -> None:
    dilo = make("released")
    generator = np.random.default_rng(5)
    shape = dilo.value.flat.shape
    forward, backward, linear = (normal(generator, *shape) for _ in range(3))
    combined = dilo.orthogonal_sum(torch.zeros(shape), forward, backward)
    kept = (combined - forward).double().reshape(len(SEEDS), -1)
    flat_forward = forward.double().reshape(len(SEEDS), -1)
    cosine = (kept * flat_forward).sum(1) / (kept.norm(dim=1) * flat_forward.norm(dim=1))
    assert cosine.abs().max() < 1e-6
    single_head = (kept * flat_forward).reshape(len(SEEDS), 2, -1).sum(2)
    assert single_head.abs().min() > 1e-2, "one scalar kappa for both heads cannot make each head orthogonal"
    with_linear = dilo.orthogonal_sum(linear, forward, backward)
    torch.testing.assert_close(with_linear - combined, linear, rtol=0.0, atol=1e-5)


def test_a_vanishing_forward_gradient_leaves_the_backward_one() -> None:
    dilo = make("released")
    backward = normal(np.random.default_rng(6), *dilo.value.flat.shape)
    zero = torch.zeros_like(backward)
    assert torch.equal(dilo.orthogonal_sum(zero, zero, backward), backward)


def test_without_backward_weight_the_gradient_is_linear_plus_forward() -> None:
    dilo = make("released", backward_weight=0.0)
    offline, expert = batches(np.random.default_rng(7))
    gradients = ref.dilo_gradients(
        heads_of(dilo, "value", 0),
        heads_of(dilo, "target", 0),
        rows_of(offline, 0),
        rows_of(expert, 0),
        ref.constants_of(dilo.config),
    )
    dilo.update("policy", offline, expert, RANDOM)
    for head in (0, 1):
        pairs = zip(gradients.linear[head], gradients.forward[head], strict=True)
        assert_gradients_agree(first_gradient(dilo, "value_optimizer", VALUE, head), [zero + f for zero, f in pairs])


def test_without_mixture_and_linear_term_the_expert_batch_has_no_effect() -> None:
    """beta = 0 lies outside the configuration's range, so the object is built around its validation."""
    config = DiloConfig.model_construct(**{**DiloConfig(hidden=HIDDEN, conservatism=1.0).model_dump(), "mixture": 0.0})
    generator = np.random.default_rng(8)
    offline, expert = batches(generator)
    _, other_expert = batches(generator)
    states = []
    for demonstration in (expert, other_expert):
        dilo = Dilo(config, SHAPES, SEEDS, CPU)
        dilo.update("policy", offline, demonstration, RANDOM)
        states.append({name: tensor.clone() for name, tensor in live_tensors(dilo).items()})
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])


def test_as_the_mixture_vanishes_so_does_the_effect_of_the_expert_batch() -> None:
    generator = np.random.default_rng(9)
    offline, expert = batches(generator)
    _, other_expert = batches(generator)

    def effect(mixture: float) -> float:
        gradients = []
        for demonstration in (expert, other_expert):
            dilo = make("released", conservatism=1.0, mixture=mixture)
            dilo.update("policy", offline, demonstration, RANDOM)
            gradients.append(live_tensors(dilo)["value_optimizer.exp_avg"].clone())
        return float((gradients[0] - gradients[1]).norm() / gradients[0].norm())

    assert effect(0.5) > 0.1
    assert effect(1e-5) < 1e-4


# --- order of a step --------------------------------------------------------------------------------------------


def test_target_moves_by_its_rate_towards_the_updated_twins_and_gets_no_gradient() -> None:
    dilo = make("released", value_learning_rate=1e-2)
    generator = np.random.default_rng(10)
    for _ in range(3):
        before = live_tensors(dilo)["target"].double().clone()
        dilo.update("policy", *batches(generator), RANDOM)
        expected = before + 0.005 * (live_tensors(dilo)["value"].double() - before)
        torch.testing.assert_close(live_tensors(dilo)["target"].double(), expected, rtol=1e-6, atol=1e-7)


def test_target_starts_as_a_copy_with_storage_of_its_own() -> None:
    dilo = build(Dilo, SHAPES, SEEDS, hidden=HIDDEN)
    assert torch.equal(live_tensors(dilo)["value"], live_tensors(dilo)["target"])
    assert live_tensors(dilo)["value"].data_ptr() != live_tensors(dilo)["target"].data_ptr()


def test_twins_and_seeds_start_differently_and_a_seed_does_not_depend_on_its_place() -> None:
    flat = live_tensors(build(Dilo, SHAPES, SEEDS, hidden=HIDDEN))["value"]
    assert len(torch.unique(flat, dim=0)) == len(flat)
    assert torch.equal(live_tensors(build(Dilo, SHAPES, (9, 4), hidden=HIDDEN))["value"], flat[[2, 3, 0, 1]])


@pytest.mark.parametrize(("tau", "value"), [(0.06, 76.75), (3.0, 1.535)])
def test_weight_reaches_its_cap_at_the_value_of_the_parity_checklist(tau: float, value: float) -> None:
    assert math.log(100.0) / tau == pytest.approx(value, abs=0.005)
    dilo = make("released", tau=tau)
    offline, _ = batches(np.random.default_rng(11))

    def weight(output: float) -> Tensor:
        set_output(dilo, "value", VALUE, output)
        return dilo.policy_weights(offline)

    assert (weight(math.log(100.0) / tau * 1.0005) == 100.0).all()
    below = weight(math.log(100.0) / tau * 0.999)
    assert (below < 100.0).all()
    assert (below > 99.0).all()
    assert (weight(0.0) == 1.0).all()
    assert (weight(1e4) == 100.0).all(), "an overflowing exponential must end at the cap, not at infinity"
    assert (weight(-1e4) == 0.0).all()


def test_weights_take_the_smaller_twin() -> None:
    dilo = make("released")
    offline, _ = batches(np.random.default_rng(12))
    weights = dilo.policy_weights(offline)
    for seed in range(len(SEEDS)):
        expected = ref.dilo_weights(
            heads_of(dilo, "value", seed), rows_of(offline, seed), ref.constants_of(dilo.config)
        )
        np.testing.assert_allclose(weights[seed].numpy(), expected, rtol=1e-5)


# --- the whole update -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("preset", "overrides"),
    [
        ("released", {}),
        ("released", {"policy_cosine_steps": 40, "target_rate": 0.1, "value_learning_rate": 3e-3}),
        ("paper", {}),
        ("paper", {"discount": 0.9, "mixture": 0.3, "backward_weight": 2.0}),
    ],
    ids=["released", "released-short-cosine", "paper", "paper-other-constants"],
)
@pytest.mark.parametrize("ended", [0.0, 0.3], ids=["none-terminal", "some-terminal"])
def test_thirty_updates_agree_with_the_reference(preset: str, overrides: dict[str, Any], ended: float) -> None:
    """Deviations stay below 1% of the distance moved: Adam turns the rounding of a gradient near 0 into a step.

    Away from such gradients float32 would leave about 1e-6 of the parameters' size; the median shows that.
    """
    dilo = make(preset, **overrides)
    references = [reference_of(dilo, seed) for seed in range(len(SEEDS))]
    start = {name: tensor.double().clone() for name, tensor in live_tensors(dilo).items() if tensor.dim()}
    generator = np.random.default_rng(13)
    for _ in range(30):
        offline, expert = batches(generator, ended)
        dilo.update("policy", offline, expert, RANDOM)
        for seed, reference in enumerate(references):
            reference.update(rows_of(offline, seed), rows_of(expert, seed))

    residuals = np.concatenate([np.ravel(r) for reference in references for r in reference.seen_residuals])
    assert 0.02 < (residuals < -2.0).mean() < 0.98, "both branches of phi must have been used"
    if preset == "paper":
        weights = np.concatenate([np.ravel(w) for reference in references for w in reference.seen_weights])
        assert 0.02 < (weights > 99.999).mean() < 0.98, "the cap must have been used, and not by every row"

    for seed, reference in enumerate(references):
        compared = [
            ("value", VALUE, 2 * seed + head, parameters) for head, parameters in enumerate(reference.heads)
        ] + [("target", VALUE, 2 * seed + head, parameters) for head, parameters in enumerate(reference.targets)]
        compared.append(("policy.network", POLICY, seed, reference.policy))
        for name, sizes, row, expected in compared:
            measured = ref.flatten(parameters_of(dilo, name, sizes, row))
            wanted = ref.flatten(expected)
            moved = np.abs(wanted - ref.flatten(ref.unflatten(start[name][row].numpy(), sizes)))
            deviation = np.abs(measured - wanted)
            assert moved.max() > 1e-4, name
            assert deviation.max() < 0.01 * moved.max() + 1e-6, name
            assert np.median(deviation) < 1e-5, name
        np.testing.assert_allclose(log_std_of(dilo, seed), reference.log_std[0], rtol=0.0, atol=1e-5)


def test_deterministic_policy_acts_by_the_tanh_of_its_network() -> None:
    dilo = make("released")
    observation = normal(np.random.default_rng(14), len(SEEDS), 10, SHAPES.observation)
    action = dilo.act(observation).detach()
    for seed in range(len(SEEDS)):
        policy = parameters_of(dilo, "policy", POLICY, seed)
        expected = np.tanh(ref.evaluate(policy, observation[seed].double().numpy()))
        np.testing.assert_allclose(action[seed].numpy(), expected, atol=1e-6)
