"""The authors' loops do what the formulas say: products counted exactly, and one step equal to the engine's.

Tolerance of one step: both sides are float32 and sum in different orders. Adam's first step moves a parameter by the
learning rate times g / (|g| + 1e-8), so a gradient near 1e-8 may move it by any part of that; such parameters are
compared by what Adam keeps of the gradient instead.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Sequence

import pytest
import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode
from weights import GivenNoise, counted, flat, load

from benchmarks.authors.bc import AuthorsBc
from benchmarks.authors.bco import AuthorsBcoInverseDynamics, AuthorsBcoPolicy
from benchmarks.authors.dilo import AuthorsDilo
from benchmarks.authors.loop import Loop
from benchmarks.authors.oril import AuthorsOril
from benchmarks.authors.smodice import AuthorsSmodice
from benchmarks.flops import flops
from benchmarks.workloads import SHAPES, WORKLOADS, synthetic
from lfobench.contract.method import Batch, Shapes
from lfobench.engine.state import live_tensors
from methods.bc import Bc, BcConfig
from methods.bco import INVERSE_DYNAMICS, Bco, BcoConfig
from methods.dilo import Dilo, DiloConfig
from methods.oril import Oril, OrilConfig
from methods.smodice import Smodice, SmodiceConfig

CPU = torch.device("cpu")
SHAPE, ROWS, HIDDEN = Shapes(5, 2), 64, (32, 32)
DATA = synthetic(SHAPE, offline_rows=500, expert_rows=99)
HOST = DATA.host()
NO_NOISE = GivenNoise()


def batches(loop: Loop) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
    """A batch of the loop's, with some terminal rows."""
    offline, expert = loop.sample()
    for batch in (offline, expert):
        if "terminated" in batch:
            batch["terminated"] = (torch.arange(ROWS) % 5 == 0).float()
    return offline, expert


def as_engine(batch: dict[str, Tensor]) -> Batch:
    """The same rows on an axis of one seed."""
    return {field: column[None] for field, column in batch.items()}  # type: ignore[misc]


def assert_same(module: nn.Module, row: Tensor, moments: Tensor, learning_rate: float) -> None:
    """Parameters within 2e-6 where the gradient is not tiny, within two steps elsewhere."""
    ours = flat(module)
    row, gradient = row[: len(ours)], moments[: len(ours)] * 10.0
    clear = gradient.abs() > 1e-4 * gradient.abs().max()
    assert clear.float().mean() > 0.5
    torch.testing.assert_close(ours[clear], row[clear], rtol=1e-5, atol=2e-6)
    assert (ours - row).abs().max() <= 2.0 * learning_rate


@pytest.mark.parametrize("name", WORKLOADS)
def test_steps_are_finite_and_change_every_network(name: str) -> None:
    loop = WORKLOADS[name].authors(HOST, SHAPE, ROWS, CPU)
    before = copy.deepcopy(loop.modules())
    for _ in range(4):
        assert all(abs(value) < 1e6 for value in loop.step().values())
    for network, module in loop.modules().items():
        for (parameter, old), new in zip(before[network].named_parameters(), module.parameters(), strict=True):
            assert torch.isfinite(new).all()
            # SMODICE's V may be shifted by any constant where no row is terminal: its last bias has the gradient
            # (1 - gamma) - (1 - gamma), and whether it moves is a matter of rounding.
            if (name, network, parameter) != ("smodice", "value", "4.bias"):
                assert not torch.equal(old, new)


@pytest.mark.parametrize("name", WORKLOADS)
def test_products_are_the_released_inventory(name: str) -> None:
    """Counted by torch, to the last multiplication."""
    workload = WORKLOADS[name]
    shapes = workload.shapes(SHAPES["hopper"])
    loop = workload.authors(synthetic(shapes, 200, 99).host(), shapes, ROWS, CPU)
    with FlopCounterMode(display=False) as counter:
        for _ in range(workload.period):
            loop.step()
    assert counter.get_total_flops() == workload.period * flops(workload.passes(shapes, ROWS, "released"))


def test_dilo_copies_eleven_tensors_and_waits_twenty_times() -> None:
    loop = AuthorsDilo(HOST, SHAPE, ROWS, CPU, HIDDEN)
    offline, expert = loop.sample()
    assert len(offline) + len(expert) == 11
    calls = counted(lambda: loop.update(offline, expert))
    # A branch on a tensor reads it like an item does. Adam reads its step counters, which it keeps on the host.
    counters = sum(1 for name in ("value", "policy") for _ in loop.modules()[name].parameters())
    assert calls["aten._local_scalar_dense"] - counters == 20


def test_dilo_step() -> None:
    loop = AuthorsDilo(HOST, SHAPE, ROWS, CPU, HIDDEN)
    engine = Dilo(DiloConfig(hidden=HIDDEN, batch_size=ROWS), SHAPE, [0], CPU)
    sizes, policy_sizes = (2 * SHAPE.observation, *HIDDEN, 1), (SHAPE.observation, *HIDDEN, SHAPE.action)
    heads = (loop.value.first, loop.value.second)
    targets = (loop.target.first, loop.target.second)
    # A target that differs from the value, and values that reach both branches of the conjugate.
    live_tensors(engine)["value"].mul_(2.0)
    for index in range(2):
        load(heads[index], live_tensors(engine)["value"][index], sizes)
        load(targets[index], live_tensors(engine)["target"][index], sizes)
    load(loop.policy, live_tensors(engine)["policy.network"][0], policy_sizes)
    offline, expert = batches(loop)
    metrics = loop.update(offline, expert)
    theirs = engine.update("policy", as_engine(offline), as_engine(expert), NO_NOISE)
    state = live_tensors(engine)
    for index in range(2):
        assert_same(heads[index], state["value"][index], state["value_optimizer.exp_avg"][index], 3e-4)
        torch.testing.assert_close(
            flat(targets[index]),
            state["target"][index][: len(flat(targets[index]))],
            rtol=1e-5,
            atol=2e-6,
        )
    assert_same(loop.policy, state["policy.network"][0], state["policy.optimizer.exp_avg"][0], 1e-4)
    for name in ("forward_loss", "backward_loss", "policy_loss", "policy_weight"):
        assert metrics[name] == pytest.approx(float(theirs[name]), rel=1e-5)


def prepared(
    loop: AuthorsSmodice | AuthorsOril, engine: Smodice | Oril, networks: Sequence[tuple[nn.Module, str, int, int]]
) -> None:
    """Give the loop the engine's discriminator and networks: (module, state name, row, inputs)."""
    load(loop.discriminator, live_tensors(engine)["discriminator.network"][0], (SHAPE.observation, *HIDDEN, 1))
    for module, name, row, inputs in networks:
        outputs = {"value": 1, "critic": 1, "actor": SHAPE.action, "policy": 2 * SHAPE.action}[
            re.split("[._]", name)[0]
        ]
        load(module, live_tensors(engine)[name][row], (inputs, *HIDDEN, outputs))


def test_smodice_step() -> None:
    loop = AuthorsSmodice(HOST, SHAPE, ROWS, CPU, HIDDEN)
    engine = Smodice(SmodiceConfig(hidden=HIDDEN, batch_size=ROWS), SHAPE, [0], CPU)
    observation = SHAPE.observation
    prepared(loop, engine, [(loop.value, "value", 0, observation), (loop.policy, "policy.network", 0, observation)])
    offline, expert = batches(loop)
    noise = torch.randn(ROWS, SHAPE.action, generator=torch.Generator().manual_seed(0))
    loop.policy.noise = lambda like: noise
    loop.update(offline, expert)
    engine.update("policy", as_engine(offline), {}, GivenNoise(noise))
    state = live_tensors(engine)
    assert_same(loop.value, state["value"][0], state["value_optimizer.exp_avg"][0], 3e-4)
    assert_same(loop.policy, state["policy.network"][0], state["policy.optimizer.exp_avg"][0], 3e-4)
    temperature = float(loop.policy.log_temperature.detach())
    assert temperature == pytest.approx(float(state["policy.log_temperature"][0, 0]), rel=1e-5)


@pytest.mark.parametrize("steps", [1, 2])
def test_oril_step(steps: int) -> None:
    """The critics after one step; the actor and the targets after two."""
    loop = AuthorsOril(HOST, SHAPE, ROWS, CPU, HIDDEN)
    engine = Oril(OrilConfig(hidden=HIDDEN, batch_size=ROWS), SHAPE, [0], CPU)
    observation, joint = SHAPE.observation, SHAPE.observation + SHAPE.action
    networks = [
        (loop.actor, "actor", 0, observation),
        (loop.actor_target, "actor_target", 0, observation),
        *((getattr(loop.critic, head), "critic", row, joint) for row, head in enumerate(("first", "second"))),
        *(
            (getattr(loop.critic_target, head), "critic_target", row, joint)
            for row, head in enumerate(("first", "second"))
        ),
    ]
    prepared(loop, engine, networks)
    offline, expert = batches(loop)
    noise = torch.randn(ROWS, SHAPE.action, generator=torch.Generator().manual_seed(0))
    loop.noise = lambda like: noise
    for step in range(steps):
        loop.update(offline, expert)
        engine.update("policy", as_engine(offline), {}, GivenNoise(noise, step % 2))
    state = live_tensors(engine)
    if steps == 1:
        for row, head in enumerate((loop.critic.first, loop.critic.second)):
            assert_same(head, state["critic"][row], state["critic_optimizer.exp_avg"][row], 3e-4)
        return
    # Critics that differ by rounding give the actor's gradient that much of a difference.
    torch.testing.assert_close(flat(loop.actor), state["actor"][0][: len(flat(loop.actor))], rtol=1e-4, atol=2e-5)
    for module, name, row, _ in networks:
        if name.endswith("target"):
            ours = flat(module)
            torch.testing.assert_close(ours, state[name][row][: len(ours)], rtol=1e-5, atol=2e-6)


def test_bc_step() -> None:
    loop = AuthorsBc(HOST, SHAPE, ROWS, CPU, HIDDEN)
    engine = Bc(BcConfig(hidden=HIDDEN, batch_size=ROWS), SHAPE, [0], CPU)
    load(loop.policy, live_tensors(engine)["policy.network"][0], (SHAPE.observation, *HIDDEN, 2 * SHAPE.action))
    offline, expert = batches(loop)
    noise = torch.randn(ROWS, SHAPE.action, generator=torch.Generator().manual_seed(0))
    loop.policy.noise = lambda like: noise
    loop.update(offline, expert)
    engine.update("policy", as_engine(offline), {}, GivenNoise(noise))
    state = live_tensors(engine)
    assert_same(loop.policy, state["policy.network"][0], state["policy.optimizer.exp_avg"][0], 3e-4)


def bco_stages() -> list[tuple[str, Callable[[Bco], Loop]]]:
    def policy(engine: Bco) -> Loop:
        model = AuthorsBcoInverseDynamics(HOST, SHAPE, ROWS, CPU, HIDDEN).model
        load(model, live_tensors(engine)["inverse_dynamics"][0], (2 * SHAPE.observation, *HIDDEN, SHAPE.action))
        return AuthorsBcoPolicy(HOST, SHAPE, ROWS, CPU, HIDDEN, model)

    return [
        (INVERSE_DYNAMICS, lambda engine: AuthorsBcoInverseDynamics(HOST, SHAPE, ROWS, CPU, HIDDEN)),
        ("policy", policy),
    ]


@pytest.mark.parametrize(("stage", "build"), bco_stages())
def test_bco_step(stage: str, build: Callable[[Bco], Loop]) -> None:
    engine = Bco(BcoConfig(hidden=HIDDEN, batch_size=ROWS), SHAPE, [0], CPU)
    loop = build(engine)
    ((name, module),) = loop.modules().items()
    inputs, rate = (2 * SHAPE.observation, 3e-4) if name == "inverse_dynamics" else (SHAPE.observation, 1e-4)
    start = live_tensors(engine)[name if name == "inverse_dynamics" else "policy.network"][0]
    load(module, start, (inputs, *HIDDEN, SHAPE.action))
    offline, expert = loop.sample()
    loop.update(offline, expert)
    # The engine labels what it draws; the loop's rows were labelled before they were drawn.
    seen = as_engine(expert)
    if stage == "policy":
        rows = torch.from_numpy(HOST.expert["observation"])
        row = torch.cdist(expert["observation"], rows).argmin(1)
        seen = {**seen, "next_observation": torch.from_numpy(HOST.expert["next_observation"])[row][None]}
    engine.update(stage, as_engine(offline), seen, NO_NOISE)
    moment = {"inverse_dynamics": "inverse_dynamics_optimizer", "policy": "policy.optimizer"}[name]
    network = {"inverse_dynamics": "inverse_dynamics", "policy": "policy.network"}[name]
    state = live_tensors(engine)
    assert_same(module, state[network][0], state[f"{moment}.exp_avg"][0], rate)
