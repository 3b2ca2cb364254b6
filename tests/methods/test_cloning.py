from __future__ import annotations

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
    random_view,
    randomize,
    rows_of,
    train,
    uniform,
)

from lfobench.contract.method import Batch, Shapes, Sizes
from lfobench.engine.state import live_tensors
from methods.bc import Bc
from methods.bc_expert import BcExpert
from methods.bco import Bco

SHAPES = Shapes(observation=5, action=3)
HIDDEN = (9, 8)
DETERMINISTIC = (SHAPES.observation, *HIDDEN, SHAPES.action)
GAUSSIAN = (SHAPES.observation, *HIDDEN, 2 * SHAPES.action)
INVERSE = (2 * SHAPES.observation, *HIDDEN, SHAPES.action)
SEEDS = (4, 9)
ROWS = 40
# Narrow, because 1 - a^2 + 1e-6 of a saturated sample is known to float32 to a few percent only.
NOISE = 0.4 * normal(np.random.default_rng(99), len(SEEDS), ROWS, SHAPES.action)


def clone(bc: Bc, batch: Batch, randomness: GivenRandomness) -> None:
    """One update; the batch of bc-expert is the expert's."""
    if isinstance(bc, BcExpert):
        bc.update("policy", NO_BATCH, batch, randomness)
    else:
        bc.update("policy", batch, NO_BATCH, randomness)


def actions_batch(seed: int) -> Batch:
    generator = np.random.default_rng(seed)
    return make_batch(("observation", "action"), SHAPES, len(SEEDS), ROWS, generator)


both_methods = pytest.mark.parametrize("method", [Bc, BcExpert], ids=["bc", "bc-expert"])


@both_methods
@pytest.mark.parametrize("loss", ["entropy-constrained", "likelihood"])
def test_likelihood_gradients(method: type[Bc], loss: str) -> None:
    bc: Bc = build(method, SHAPES, SEEDS, hidden=HIDDEN, loss=loss)
    batch = actions_batch(1)
    # With the initial zero biases a row that no hidden unit answers sits on a kink of the loss.
    randomize(bc, "policy", GAUSSIAN, 0.5)
    policies = [parameters_of(bc, "policy", GAUSSIAN, seed) for seed in range(len(SEEDS))]
    constrained = loss == "entropy-constrained"
    clone(bc, batch, GivenRandomness(normal=NOISE if constrained else None))
    for seed, policy in enumerate(policies):
        rows = rows_of(batch, seed)
        noise = NOISE[seed].double().numpy() if constrained else None

        def total(trial: ref.Parameters, rows: ref.Rows = rows, noise: ref.Array | None = noise) -> float:
            return ref.tanh_gaussian_loss(trial, rows, np.ones(ROWS), 0.0, noise)

        expected = ref.numerical_gradient(total, policy)
        assert_gradients_agree(first_gradient(bc, "policy.optimizer", GAUSSIAN, seed), expected, tolerance=1e-4)
        temperature = live_tensors(bc)["policy.temperature_optimizer.exp_avg"][seed, 0].item() * 10.0
        wanted = 0.0
        if noise is not None:
            wanted = -(ref.negative_entropy(policy, rows["observation"], noise) - SHAPES.action)
        assert temperature == pytest.approx(wanted, rel=1e-4)


@both_methods
def test_squared_error_gradient(method: type[Bc]) -> None:
    bc: Bc = build(method, SHAPES, SEEDS, hidden=HIDDEN, loss="squared")
    batch = actions_batch(2)
    policies = [parameters_of(bc, "policy", DETERMINISTIC, seed) for seed in range(len(SEEDS))]
    clone(bc, batch, GivenRandomness())
    for seed, policy in enumerate(policies):
        expected = ref.regression_gradient(policy, rows_of(batch, seed), np.ones(ROWS))
        assert_gradients_agree(first_gradient(bc, "policy.optimizer", DETERMINISTIC, seed), expected)


def test_temperature_falls_while_the_entropy_is_above_its_target() -> None:
    """Uniform actions on a box of side 2 have entropy 2 log 2 = 1.4, far above the target of -2."""
    bc: Bc = build(Bc, Shapes(2, 2), (0, 1), hidden=(16, 16), learning_rate=1e-2, batch_size=128)
    view = random_view(Bc.needs(bc.config), Shapes(2, 2), 2000, 0)
    metrics = train(bc, bc.stages(view.sizes)[0], view, (0, 1), 200)
    entropy = torch.stack([step["entropy"] for step in metrics[-50:]]).mean(0)
    assert (entropy > 0.0).all()
    assert (live_tensors(bc)["policy.log_temperature"][:, 0] < -1.0).all()


def test_inverse_dynamics_gradient() -> None:
    bco: Bco = build(Bco, SHAPES, SEEDS, hidden=HIDDEN)
    generator = np.random.default_rng(3)
    offline = make_batch(Bco.needs(bco.config).offline, SHAPES, len(SEEDS), ROWS, generator)
    networks = [parameters_of(bco, "inverse_dynamics", INVERSE, seed) for seed in range(len(SEEDS))]
    policy = live_tensors(bco)["policy.network"].clone()
    bco.update("inverse dynamics", offline, NO_BATCH, GivenRandomness())
    for seed, network in enumerate(networks):
        rows = rows_of(offline, seed)
        pairs = {
            "observation": np.concatenate([rows["observation"], rows["next_observation"]], 1),
            "action": rows["action"],
        }
        expected = ref.regression_gradient(network, pairs, np.ones(ROWS))
        assert_gradients_agree(first_gradient(bco, "inverse_dynamics_optimizer", INVERSE, seed), expected)
    assert torch.equal(live_tensors(bco)["policy.network"], policy)


def test_bco_policy_gradient_clones_the_inferred_actions() -> None:
    bco: Bco = build(Bco, SHAPES, SEEDS, hidden=HIDDEN)
    generator = np.random.default_rng(4)
    expert = make_batch(Bco.needs(bco.config).expert, SHAPES, len(SEEDS), ROWS, generator)
    randomize(bco, "inverse_dynamics", INVERSE, 1.0)
    frozen = live_tensors(bco)["inverse_dynamics"].clone()
    policies = [parameters_of(bco, "policy", DETERMINISTIC, seed) for seed in range(len(SEEDS))]
    bco.update("policy", NO_BATCH, expert, GivenRandomness())
    for seed, policy in enumerate(policies):
        rows = rows_of(expert, seed)
        network = parameters_of(bco, "inverse_dynamics", INVERSE, seed)
        inputs = np.concatenate([rows["observation"], rows["next_observation"]], 1)
        labelled = {"observation": rows["observation"], "action": np.tanh(ref.evaluate(network, inputs))}
        expected = ref.regression_gradient(policy, labelled, np.ones(ROWS))
        assert_gradients_agree(first_gradient(bco, "policy.optimizer", DETERMINISTIC, seed), expected)
    assert torch.equal(live_tensors(bco)["inverse_dynamics"], frozen)


def test_inverse_dynamics_stage_draws_as_many_rows_as_its_epochs_hold() -> None:
    bco: Bco = build(Bco, SHAPES, SEEDS, batch_size=1024, inverse_dynamics_epochs=5)
    inverse, policy = bco.stages(Sizes(offline=10_000, expert=999))
    assert (inverse.steps, inverse.offline_batch, inverse.expert_batch) == (50, 1024, 0)
    assert (policy.steps, policy.offline_batch, policy.expert_batch) == (None, 0, 1024)


@pytest.mark.slow
def test_bco_recovers_the_expert_where_the_next_state_tells_the_action() -> None:
    """s' = s + a: the label of an expert pair is its displacement, and cloning it is the expert."""
    seeds, shapes = (0, 1), Shapes(2, 2)
    bco: Bco = build(
        Bco, shapes, seeds, hidden=(32, 32), inverse_dynamics_learning_rate=3e-3, policy_learning_rate=3e-3
    )
    generator = np.random.default_rng(5)

    def pairs(action: torch.Tensor | None) -> Batch:
        state = normal(generator, len(seeds), 256, 2)
        chosen = uniform(generator, *state.shape) * 2.0 - 1.0 if action is None else -0.8 * torch.tanh(state)
        return {"observation": state, "action": chosen, "next_observation": state + chosen}

    for _ in range(400):
        bco.update("inverse dynamics", pairs(None), NO_BATCH, GivenRandomness())
    for _ in range(400):
        expert = pairs(torch.zeros(()))
        bco.update(
            "policy", NO_BATCH, {**expert, "action": torch.full_like(expert["action"], torch.nan)}, GivenRandomness()
        )
    state = normal(generator, len(seeds), 500, 2)
    assert (bco.act(state) + 0.8 * torch.tanh(state)).abs().mean() < 0.08
