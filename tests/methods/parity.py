"""Twenty updates of every method in float64, kept as numbers: ``python tests/methods/parity.py`` makes them anew.

A case is a method under a preset, two seeds. Its arrays: the initial networks as float32, the batches and random
numbers of every update, and the networks after the last one as the references of `references` in float64 have them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import references as ref
import torch
from method_helpers import CPU, GivenRandomness, flat_of, make_batch, normal, rows_of, uniform
from numpy.typing import NDArray
from references import AdamReference, Array, Parameters, flatten, unflatten

from lfobench.contract.method import Batch, Method, Shapes
from lfobench.engine.state import live_tensors
from lfobench.registry import load_method

FILE = Path(__file__).with_name("parity.npz")
STEPS, ROWS, SEEDS = 20, 16, (0, 1)
SHAPES, HIDDEN = Shapes(3, 2), (8, 8)
PAIR = 2 * SHAPES.observation

Sizes = Mapping[str, tuple[int, ...]]
Networks = dict[str, Parameters]
"""One seed's networks by name; a head of a twin is ``critic:0``."""


@dataclass(frozen=True)
class Case:
    """A method under a preset.

    Attributes:
        method: its name.
        preset: of the method.
        overrides: fields that make twenty updates reach the branches that a whole run does.
        sizes: of every network that training changes, by its name in the method's state.
        stages: in order, every one of `STEPS` updates.
        reference: moves one seed's networks through a stage, `STEPS` times.
    """

    method: str
    preset: str
    overrides: Mapping[str, Any]
    sizes: Sizes
    stages: tuple[str, ...]
    reference: Callable[[Networks, Any, list[Inputs]], None]

    @property
    def name(self) -> str:
        return f"{self.method}:{self.preset}"

    def build(self, **mutation: Any) -> Any:
        """The shipped method."""
        kind = load_method(self.method)
        fields = {"hidden": HIDDEN, **kind.presets[self.preset], **self.overrides, **mutation}
        return kind(kind.Config(**fields), SHAPES, SEEDS, CPU)


@dataclass(frozen=True)
class Inputs:
    """What one update of a stage is given, for all seeds or for one."""

    stage: str
    phase: int
    offline: Mapping[str, Any]
    expert: Mapping[str, Any]
    normal: Any
    uniform: Any

    def of_seed(self, seed: int) -> Inputs:
        """One seed's part in float64."""
        return Inputs(
            self.stage,
            self.phase,
            rows_of(self.offline, seed),
            rows_of(self.expert, seed),
            self.normal[seed].double().numpy(),
            self.uniform[seed].double().numpy(),
        )


def draw(case: Case, method: Method) -> Iterator[Inputs]:
    """Inputs of every update, by NumPy's generator."""
    generator = np.random.default_rng(sum(map(ord, case.name)))
    needs = method.needs(method.config)
    for stage in case.stages:
        for step in range(STEPS):
            offline: Batch = make_batch(needs.offline, SHAPES, len(SEEDS), ROWS, generator)
            expert: Batch = make_batch(needs.expert, SHAPES, len(SEEDS), ROWS, generator)
            yield Inputs(
                stage,
                step % 2,
                offline,
                expert,
                normal(generator, len(SEEDS), ROWS, SHAPES.action),
                uniform(generator, len(SEEDS), ROWS, 1),
            )


_KINDS = ("offline", "expert", "normal", "uniform")


def pack(everything: list[Inputs]) -> dict[str, NDArray[np.float32]]:
    """The inputs as arrays over updates, ``[T, S, B, ...]``."""
    packed = {}
    for kind in _KINDS:
        values = [getattr(each, kind) for each in everything]
        fields = {f"{kind}/{field}": field for field in values[0]} if isinstance(values[0], dict) else {kind: None}
        for name, field in fields.items():
            packed[name] = np.stack([(value if field is None else value[field]).numpy() for value in values])
    return packed


def unpack(case: Case, packed: Mapping[str, NDArray[np.float32]]) -> list[Inputs]:
    """The inverse of `pack`."""

    def batch(kind: str, update: int) -> dict[str, torch.Tensor]:
        prefix = f"{kind}/"
        found = {name.removeprefix(prefix): array for name, array in packed.items() if name.startswith(prefix)}
        return {field: torch.from_numpy(array[update].copy()) for field, array in found.items()}

    return [
        Inputs(
            stage,
            update % 2,
            batch("offline", index * STEPS + update),
            batch("expert", index * STEPS + update),
            torch.from_numpy(packed["normal"][index * STEPS + update].copy()),
            torch.from_numpy(packed["uniform"][index * STEPS + update].copy()),
        )
        for index, stage in enumerate(case.stages)
        for update in range(STEPS)
    ]


def replay(
    case: Case, method: Method, initial: Mapping[str, NDArray[np.float32]], everything: list[Inputs]
) -> dict[str, Array]:
    """The networks of the shipped method, taken from the initial ones through every update.

    Returns:
        by name, ``[seeds * heads, P]`` without padding.
    """
    for name in case.sizes:
        flat_of(method, name).copy_(torch.from_numpy(initial[name]))
    for name, source in TARGETS.get(case.method, {}).items():
        flat_of(method, name).copy_(torch.from_numpy(initial[source]))
    for each in everything:
        randomness = GivenRandomness(each.phase, normal=each.normal, uniform=each.uniform)
        method.update(each.stage, each.offline, each.expert, randomness)  # type: ignore[arg-type]

    return {
        name: np.stack([flatten(unflatten(row, sizes)) for row in flat_of(method, name).detach().double().numpy()])
        for name, sizes in (case.sizes | target_sizes(case)).items()
    }


TARGETS = {
    "dilo": {"target": "value"},
    "oril": {"actor_target": "actor", "critic_target": "critic"},
    "seabo": {"iql.target": "iql.critic"},
}
"""Copies that a method makes of its networks, by method."""


def target_sizes(case: Case) -> Sizes:
    return {name: case.sizes[source] for name, source in TARGETS.get(case.method, {}).items()}


def expected(
    case: Case, method: Method, initial: Mapping[str, NDArray[np.float32]], everything: list[Inputs]
) -> dict[str, Array]:
    """The networks of the float64 references, shaped as those of `replay`."""
    found: dict[str, list[Array]] = {name: [] for name in case.sizes | target_sizes(case)}
    for seed in range(len(SEEDS)):
        networks: Networks = {}
        for name, sizes in case.sizes.items():
            heads = len(initial[name]) // len(SEEDS)
            for head in range(heads):
                layers = unflatten(initial[name][seed * heads + head].astype(np.float64), sizes)
                networks[f"{name}:{head}" if heads > 1 else name] = layers
        case.reference(networks, method.config, [each.of_seed(seed) for each in everything])
        for name in found:
            found[name] += [flatten(layers) for key, layers in networks.items() if key.partition(":")[0] == name]
    return {name: np.stack(rows) for name, rows in found.items()}


# --- the references, one seed each ---------------------------------------------------------------


def dilo(networks: Networks, config: Any, steps: list[Inputs]) -> None:
    heads = [networks["value:0"], networks["value:1"]]
    run = ref.DiloReference(heads, networks["policy.network"], np.zeros(SHAPES.action), ref.constants_of(config))
    for each in steps:
        run.update(each.offline, each.expert)
    networks |= {f"value:{index}": head for index, head in enumerate(run.heads)}
    networks |= {f"target:{index}": head for index, head in enumerate(run.targets)}
    networks["policy.network"] = run.policy


def discriminator(networks: Networks, config: Any, steps: list[Inputs]) -> None:
    """The first stage of SMODICE and ORIL."""
    layers, adam = networks["discriminator.network"], AdamReference()
    for each in steps:
        if each.stage == "discriminator":

            def loss(trial: Parameters, each: Inputs = each) -> float:
                states = each.expert["observation"], each.offline["observation"]
                return ref.discriminator_loss(trial, *states, each.uniform, config.gradient_penalty)

            gradient = ref.numerical_gradient(loss, layers)
            if config.freeze_first_layer:
                gradient[:2] = [np.zeros_like(layer) for layer in gradient[:2]]
            adam.step(layers, gradient, config.discriminator_learning_rate)


class TanhGaussianReference:
    """Policy and temperature of SMODICE and BC."""

    def __init__(self, policy: Parameters, constrained: bool, rate: float) -> None:
        self.policy, self.constrained, self.rate = policy, constrained, rate
        self.log_temperature = [np.zeros(1)]
        self.adam, self.temperature_adam = AdamReference(), AdamReference()

    def update(self, each: Inputs, weight: Array) -> None:
        noise = each.normal if self.constrained else None
        temperature = float(self.log_temperature[0][0])

        def loss(trial: Parameters) -> float:
            return ref.tanh_gaussian_loss(trial, each.offline, weight, temperature, noise)

        gradient = ref.numerical_gradient(loss, self.policy)
        if self.constrained:
            entropy = -ref.negative_entropy(self.policy, each.offline["observation"], each.normal)
            excess = np.array([entropy + SHAPES.action])
        self.adam.step(self.policy, gradient, self.rate)
        if self.constrained:
            self.temperature_adam.step(self.log_temperature, [excess], self.rate)


def smodice(networks: Networks, config: Any, steps: list[Inputs]) -> None:
    discriminator(networks, config, steps)
    value, adam = networks["value"], AdamReference()
    policy = TanhGaussianReference(networks["policy.network"], config.entropy_constraint, config.learning_rate)
    for each in steps:
        if each.stage != "discriminator":
            reward = ref.evaluate(networks["discriminator.network"], each.offline["observation"], np.tanh)[:, 0]
            residual = ref.smodice_residual(value, reward, each.offline, config.discount)
            gradient = ref.smodice_value_gradient(value, reward, each.offline, config.discount, config.divergence)
            decayed = [slope + config.value_weight_decay * layer for slope, layer in zip(gradient, value, strict=True)]
            weight = np.exp(residual) if config.divergence == "kl" else np.maximum(0.0, residual + 1.0)
            adam.step(value, decayed, config.learning_rate)
            policy.update(each, weight)


def oril(networks: Networks, config: Any, steps: list[Inputs]) -> None:
    discriminator(networks, config, steps)
    critics, actor = [networks["critic:0"], networks["critic:1"]], networks["actor"]
    targets = [[layer.copy() for layer in network] for network in (*critics, actor)]
    adams, actor_adam = [AdamReference(), AdamReference()], AdamReference()
    for each in steps:
        if each.stage != "discriminator":
            reward = ref.evaluate(networks["discriminator.network"], each.offline["observation"], np.tanh)[:, 0]
            target = ref.oril_target(targets[2], targets[:2], reward, each.offline, each.normal)
            gradients = ref.oril_critic_gradients(critics, each.offline, target)
            for critic, adam, gradient in zip(critics, adams, gradients, strict=True):
                adam.step(critic, gradient, config.learning_rate)
            if each.phase == 1:
                scale = ref.oril_scale(actor, critics[0], each.offline)

                def loss(trial: Parameters, each: Inputs = each, scale: float = scale) -> float:
                    return ref.oril_actor_loss(trial, critics[0], each.offline, scale)

                actor_adam.step(actor, ref.numerical_gradient(loss, actor), config.learning_rate)
                for followed, network in zip(targets, (*critics, actor), strict=True):
                    for index, layer in enumerate(network):
                        followed[index] += config.target_rate * (layer - followed[index])
    networks |= {"critic_target:0": targets[0], "critic_target:1": targets[1], "actor_target": targets[2]}


def seabo(networks: Networks, config: Any, steps: list[Inputs]) -> None:
    critics = [networks["iql.critic:0"], networks["iql.critic:1"]]
    value, policy = networks["iql.value"], networks["iql.policy.network"]
    targets = [[layer.copy() for layer in critic] for critic in critics]
    adams, value_adam, policy_adam = [AdamReference(), AdamReference()], AdamReference(), AdamReference()
    for update, each in enumerate(steps):
        rows = each.offline
        pairs = np.concatenate([rows["observation"], rows["action"]], 1)
        q = np.minimum(*(ref.evaluate(target, pairs)[:, 0] for target in targets))
        value_adam.step(value, ref.expectile_gradient(value, rows, q, config.expectile), config.learning_rate)
        weight = ref.iql_weights(value, rows, q, config.inverse_temperature, config.weight_limit) / SHAPES.action
        rate = config.learning_rate * (1.0 + np.cos(np.pi * update / config.policy_cosine_steps)) / 2.0
        policy_adam.step(policy, ref.regression_gradient(policy, rows, weight), rate)
        gradients = ref.iql_critic_gradients(critics, value, rows, rows["label"], config.discount)
        for critic, adam, gradient in zip(critics, adams, gradients, strict=True):
            adam.step(critic, gradient, config.learning_rate)
        for followed, critic in zip(targets, critics, strict=True):
            for index, layer in enumerate(critic):
                followed[index] += config.target_rate * (layer - followed[index])
    networks |= {"iql.target:0": targets[0], "iql.target:1": targets[1]}


def bco(networks: Networks, config: Any, steps: list[Inputs]) -> None:
    inverse, policy = networks["inverse_dynamics"], networks["policy.network"]
    inverse_adam, policy_adam = AdamReference(), AdamReference()
    for each in steps:
        rows = each.offline if each.stage == "inverse dynamics" else each.expert
        pairs = np.concatenate([rows["observation"], rows["next_observation"]], 1)
        even = np.ones(ROWS)
        if each.stage == "inverse dynamics":
            gradient = ref.regression_gradient(inverse, {"observation": pairs, "action": rows["action"]}, even)
            inverse_adam.step(inverse, gradient, config.inverse_dynamics_learning_rate)
        else:
            label = np.tanh(ref.evaluate(inverse, pairs))
            labelled = {"observation": rows["observation"], "action": label}
            policy_adam.step(policy, ref.regression_gradient(policy, labelled, even), config.policy_learning_rate)


def bc(networks: Networks, config: Any, steps: list[Inputs]) -> None:
    constrained = config.loss == "entropy-constrained"
    policy = TanhGaussianReference(networks["policy.network"], constrained, config.learning_rate)
    for each in steps:
        policy.update(each, np.ones(ROWS))


_STATE, _DETERMINISTIC = (SHAPES.observation, *HIDDEN, 1), (SHAPES.observation, *HIDDEN, SHAPES.action)
_GAUSSIAN = (SHAPES.observation, *HIDDEN, 2 * SHAPES.action)
_DILO: Sizes = {"value": (PAIR, *HIDDEN, 1), "policy.network": _DETERMINISTIC}
_SMODICE: Sizes = {"discriminator.network": _STATE, "value": _STATE, "policy.network": _GAUSSIAN}
_ORIL: Sizes = {
    "discriminator.network": _STATE,
    "critic": (SHAPES.observation + SHAPES.action, *HIDDEN, 1),
    "actor": _DETERMINISTIC,
}
_BCO: Sizes = {"inverse_dynamics": (PAIR, *HIDDEN, SHAPES.action), "policy.network": _DETERMINISTIC}
_SEABO: Sizes = {
    "iql.value": _STATE,
    "iql.critic": (SHAPES.observation + SHAPES.action, *HIDDEN, 1),
    "iql.policy.network": _DETERMINISTIC,
}
# Rates that move networks of this size far enough in twenty updates.
_RATE = {"learning_rate": 3e-3}
_BOTH = {**_RATE, "discriminator_learning_rate": 3e-3}
_DILO_RATES = {"value_learning_rate": 3e-3, "policy_learning_rate": 3e-3, "target_rate": 0.05}
CASES = (
    Case("dilo", "released", {**_DILO_RATES, "policy_cosine_steps": 40, "tau": 0.5}, _DILO, ("policy",), dilo),
    Case("dilo", "paper", {**_DILO_RATES, "weight_limit": 1.3}, _DILO, ("policy",), dilo),
    Case("smodice", "released", _BOTH, _SMODICE, ("discriminator", "policy"), smodice),
    Case("smodice", "paper", {**_BOTH, "divergence": "chi2"}, _SMODICE, ("discriminator", "policy"), smodice),
    Case("oril", "released", {**_BOTH, "target_rate": 0.05}, _ORIL, ("discriminator", "policy"), oril),
    Case("oril", "paper", {**_BOTH, "target_rate": 0.05}, _ORIL, ("discriminator", "policy"), oril),
    Case(
        "bco",
        "released",
        {"inverse_dynamics_learning_rate": 3e-3, "policy_learning_rate": 3e-3},
        _BCO,
        ("inverse dynamics", "policy"),
        bco,
    ),
    Case(
        "seabo",
        "released",
        {**_RATE, "target_rate": 0.05, "policy_cosine_steps": 40, "weight_limit": 3.0},
        _SEABO,
        ("policy",),
        seabo,
    ),
    Case("bc", "released", _RATE, {"policy.network": _GAUSSIAN}, ("policy",), bc),
    Case("bc", "paper", _RATE, {"policy.network": _GAUSSIAN}, ("policy",), bc),
)


def initial_networks(case: Case, method: Method) -> dict[str, NDArray[np.float32]]:
    """``[seeds * heads, P]`` with padding, as the shipped method draws them."""
    return {name: live_tensors(method)[_live(method, name)].numpy().copy() for name in case.sizes}


def _live(method: Method, name: str) -> str:
    return name if name in live_tensors(method) else f"{name}.network"


def make(case: Case) -> dict[str, NDArray[Any]]:
    """The arrays of a case by their names in the file."""
    method = case.build()
    initial, everything = initial_networks(case, method), list(draw(case, method))
    parts = {
        "initial": initial,
        "inputs": pack(everything),
        "final": expected(case, method, initial, everything),
    }
    return {f"{case.name}/{part}/{name}": array for part, arrays in parts.items() for name, array in arrays.items()}


def read(case: Case, part: str) -> dict[str, NDArray[Any]]:
    """The ``initial`` or ``final`` networks of a case, or its ``inputs``."""
    prefix = f"{case.name}/{part}/"
    with np.load(FILE, allow_pickle=False) as kept:
        return {name.removeprefix(prefix): kept[name] for name in kept.files if name.startswith(prefix)}


if __name__ == "__main__":
    arrays = {name: array for case in CASES for name, array in make(case).items()}
    np.savez_compressed(FILE, **arrays)  # type: ignore[arg-type]
    sys.stdout.write(f"{FILE}: {len(arrays)} arrays, {FILE.stat().st_size} bytes\n")
