from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from method_helpers import (
    CPU,
    NO_BATCH,
    GivenRandomness,
    make_batch,
    normal,
    random_view,
    seed_slices,
    train,
    uniform,
)
from torch import Tensor

from lfobench import registry
from lfobench.contract.method import Batch, Method, PresetName, Shapes
from lfobench.data.firewall import View
from lfobench.engine.state import live_tensors

HOPPER = Shapes(observation=11, action=3)
SEEDS = (0, 1, 2, 3, 4, 5, 6)
PLACE = 3
UPDATES = 20
SMALL: Mapping[str, Any] = {"hidden": (32, 32), "batch_size": 64}

# A method and the metrics of its updates.
Trained = tuple[Method, list[dict[str, Tensor]]]

methods = pytest.mark.parametrize("name", registry.method_names())
presets = pytest.mark.parametrize("preset", ["released", "paper"])


@cache
def view_of(name: str, expert_rows: int, shapes: Shapes = HOPPER) -> View:
    method = registry.load_method(name)
    return random_view(method.needs(method.Config()), shapes, 2000, expert_rows)


def configured(name: str, preset: PresetName, overrides: Mapping[str, Any]) -> Any:
    method = registry.load_method(name)
    return method.Config(**{**method.presets[preset], **overrides})


def run_all_stages(
    name: str, config: Any, seeds: Sequence[int], expert_rows: int, updates: int = UPDATES, shapes: Shapes = HOPPER
) -> Trained:
    """`updates` of every stage, in order."""
    method = registry.load_method(name)(config, shapes, seeds, CPU)
    view, metrics = view_of(name, expert_rows, shapes), []
    for stage in method.stages(view.sizes):
        metrics += train(method, stage, view, seeds, updates)
    return method, metrics


def assert_same_seed(among: Trained, alone: Trained, seeds: Sequence[int], width: int = HOPPER.observation) -> None:
    """State, metrics and actions of the one seed that both trained, bit for bit."""
    (group, group_metrics), (single, single_metrics) = among, alone
    place = seeds.index(SEEDS[PLACE])
    for step, (many, one) in enumerate(zip(group_metrics, single_metrics, strict=True)):
        differing = [metric for metric in one if not torch.equal(many[metric][place], one[metric][0])]
        assert not differing, f"update {step} counted over all stages: {differing}"
    many_state, one_state = seed_slices(group, len(seeds), place), seed_slices(single, 1, 0)
    differing = [tensor for tensor in one_state if not torch.equal(many_state[tensor], one_state[tensor])]
    assert not differing
    for rows in (1, 5, 10):
        observation = normal(np.random.default_rng(rows), len(seeds), rows, width)
        many_actions, one_action = group.act(observation), single.act(observation[place : place + 1])
        assert torch.equal(many_actions[place], one_action[0]), f"actions for {rows} observations"


@pytest.mark.slow
@methods
@presets
def test_a_seed_alone_equals_the_same_seed_among_seven(name: str, preset: PresetName) -> None:
    overrides = dict(SMALL)
    if "discriminator_batch" in registry.load_method(name).Config.model_fields:
        overrides["discriminator_batch"] = 48
    config = configured(name, preset, overrides)
    among = run_all_stages(name, config, SEEDS, expert_rows=100)
    alone = run_all_stages(name, config, SEEDS[PLACE : PLACE + 1], expert_rows=100)
    assert_same_seed(among, alone, SEEDS)


@methods
@pytest.mark.parametrize("seeds", [(3, 0), (6, 5, 3), (9, 3, 1, 2, 4)], ids=["two", "three", "five"])
def test_a_seed_does_not_depend_on_its_place_or_company(name: str, seeds: tuple[int, ...]) -> None:
    config = configured(name, "released", SMALL)
    among = run_all_stages(name, config, seeds, expert_rows=100, updates=5)
    alone = run_all_stages(name, config, SEEDS[PLACE : PLACE + 1], expert_rows=100, updates=5)
    assert_same_seed(among, alone, seeds)


@methods
@pytest.mark.parametrize(
    ("shapes", "hidden"),
    [
        (Shapes(1, 1), (32, 32)),
        (Shapes(2, 1), (17,)),
        (Shapes(17, 6), (33, 100)),
        (Shapes(45, 24), (64, 32, 16)),
        (Shapes(112, 8), (128, 8)),
    ],
    ids=["1-1", "2-1", "17-6", "45-24", "112-8"],
)
def test_no_width_of_a_vector_or_layer_breaks_this(name: str, shapes: Shapes, hidden: tuple[int, ...]) -> None:
    """Vector kernels and matrix products choose their path by width; a path may round by what lies beside."""
    seeds = (3, 0, 5)
    config = configured(name, "paper", {"hidden": hidden, "batch_size": 50})
    among = run_all_stages(name, config, seeds, expert_rows=99, updates=5, shapes=shapes)
    alone = run_all_stages(name, config, SEEDS[PLACE : PLACE + 1], expert_rows=99, updates=5, shapes=shapes)
    assert_same_seed(among, alone, seeds, shapes.observation)


@pytest.mark.slow
@methods
def test_a_seed_alone_equals_the_same_seed_among_seven_at_full_size(name: str) -> None:
    """Released widths and batches, and 1000 expert rows, whose passes of the discriminator end in 232 rows.

    Every stage sees five updates: the discriminator's fourth is the short one.
    """
    config = configured(name, "released", {})
    among = run_all_stages(name, config, SEEDS, expert_rows=1000, updates=5)
    alone = run_all_stages(name, config, SEEDS[PLACE : PLACE + 1], expert_rows=1000, updates=5)
    assert_same_seed(among, alone, SEEDS)


@methods
@pytest.mark.parametrize("poison", [float("nan"), float("inf"), 1e30], ids=["nan", "inf", "huge"])
@pytest.mark.parametrize("where", ["batch", "weights"])
def test_a_diverging_seed_leaves_the_others_bit_for_bit_as_they_were(name: str, poison: float, where: str) -> None:
    config = configured(name, "released", SMALL)
    healthy, diverging = (registry.load_method(name)(config, HOPPER, SEEDS, CPU) for _ in range(2))
    if where == "weights":
        for tensor in live_tensors(diverging).values():
            if tensor.dim():
                tensor.view(len(SEEDS), -1)[PLACE, ::7] = poison
    healthy_metrics, diverging_metrics = (
        run_on_given_batches(method, poison if where == "batch" and method is diverging else None)
        for method in (healthy, diverging)
    )
    others = [place for place in range(len(SEEDS)) if place != PLACE]
    for clean, dirty in zip(healthy_metrics, diverging_metrics, strict=True):
        assert all(torch.equal(clean[metric][others], dirty[metric][others]) for metric in clean)
    for place in others:
        expected, found = (seed_slices(method, len(SEEDS), place) for method in (healthy, diverging))
        assert [tensor for tensor in expected if not torch.equal(expected[tensor], found[tensor])] == []
    observation = normal(np.random.default_rng(1), len(SEEDS), 10, HOPPER.observation)
    assert torch.equal(healthy.act(observation)[others], diverging.act(observation)[others])
    acting = {"oril": "actor", "seabo": "iql.policy.network"}.get(name, "policy.network")
    assert not torch.equal(live_tensors(healthy)[acting][PLACE], live_tensors(diverging)[acting][PLACE])


def run_on_given_batches(method: Method, poison: float | None) -> list[dict[str, Tensor]]:
    """Four updates of every stage; one seed's observations are poisoned from the second on."""
    needs = method.needs(method.config)  # type: ignore[attr-defined]
    metrics = []
    for index, stage in enumerate(method.stages(view_of(method.name, 100).sizes)):
        for step in range(4):
            generator = np.random.default_rng(100 * index + step)
            rows = max(stage.offline_batch, stage.expert_batch)
            batches: list[Batch] = []
            for fields, size in ((needs.offline, stage.offline_batch), (needs.expert, stage.expert_batch)):
                batch = make_batch(fields, HOPPER, len(SEEDS), size, generator) if size else NO_BATCH
                if poison is not None and step > 0 and batch:
                    batch["observation"][PLACE, ::3] = poison
                batches.append(batch)
            width = 1 if stage.name == "discriminator" else HOPPER.action
            randomness = GivenRandomness(
                step % stage.period,
                normal=normal(generator, len(SEEDS), rows, HOPPER.action),
                uniform=uniform(generator, len(SEEDS), rows, width),
            )
            metrics.append(method.update(stage.name, *batches, randomness))
    return metrics
