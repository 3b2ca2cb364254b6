"""Decision 3: what a method may not see is not there. The tests try to leak it."""

from __future__ import annotations

import dataclasses
import gc
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
import torch
from helpers_engine import Drifting, batches_at
from raw_rows import make_episodes
from torch import Tensor

from lfobench.contract.episodes import Episodes
from lfobench.contract.method import DataNeeds, Field, Method, Stage
from lfobench.contract.suite import Recipe
from lfobench.data.firewall import FirewallError, View, view
from lfobench.data.mixing import mix
from lfobench.engine.batches import Draws, RunningStep, StageSampler
from lfobench.randomness import Randomness
from lfobench.registry import load_method, method_names

REWARD = 7_777.25
EXPERT_ACTION = 0.8125
CPU = torch.device("cpu")

CONFIGURATIONS = [(name, preset) for name in method_names() for preset in load_method(name).presets]


def poisoned(expert_trajectories: int) -> tuple[Episodes, Episodes, Recipe]:
    """Rewards and expert actions that occur nowhere else."""
    offline = make_episodes([(9, False), (5, True), (9, False)])
    expert = make_episodes([(9, False)] * 4 + [(6, True)], start=900)
    offline = dataclasses.replace(
        offline, observations=offline.observations / 1e3, actions=offline.actions / 1e4, rewards=offline.rewards * 0
    )
    expert = dataclasses.replace(
        expert, observations=expert.observations / 1e3, actions=np.full_like(expert.actions, EXPERT_ACTION)
    )
    offline.rewards[:] = REWARD
    expert.rewards[:] = REWARD
    return offline, expert, Recipe("random", 23, "expert", expert_trajectories, 9)


def view_of(name: str, preset: str, expert_trajectories: int = 2) -> tuple[type[Method], Any, DataNeeds, View]:
    method = load_method(name)
    config = method.Config.model_validate(method.presets[preset])  # type: ignore[index]
    offline, expert, recipe = poisoned(expert_trajectories)
    needs = method.needs(config)
    mixture = mix(offline, expert, recipe, needs, 9)
    labels = torch.zeros(len(mixture.actions)) if "label" in needs.offline else None
    return method, config, needs, view(method, needs, mixture, CPU, labels)


def arrays_within(thing: object) -> Iterator[np.ndarray]:
    """Every tensor and array that can be reached from `thing`, through anything Python can follow."""
    seen: set[int] = set()
    waiting = [thing]
    while waiting:
        current = waiting.pop()
        if id(current) in seen or isinstance(current, type) or hasattr(current, "__spec__") or callable(current):
            continue
        seen.add(id(current))
        if isinstance(current, Tensor):
            # The whole storage, not only the part that this view of it shows.
            yield torch.as_strided(
                current, (current.untyped_storage().size() // current.element_size(),), (1,), 0
            ).numpy()
        elif isinstance(current, np.ndarray):
            yield current
            if current.base is not None:
                waiting.append(current.base)
        else:
            waiting += gc.get_referents(current)


def holds(thing: object, value: float) -> bool:
    """Whether any number within reach of `thing` is `value`."""
    return any(bool((np.asarray(array) == value).any()) for array in arrays_within(thing))


def batches(method: type[Method], config: Any, sight: View) -> Iterator[tuple[str, dict[Field, Tensor], Any]]:
    """Some batches of every stage, as training draws them."""
    instance = method(config, sight.shapes, [0, 1], CPU)
    for stage in instance.stages(sight.sizes):
        sampler = StageSampler(sight, stage, Randomness([0, 1]))
        for step in range(3):
            offline, expert = batches_at(sampler, step)
            if stage.offline_batch:
                yield "offline", dict(offline), stage
            if stage.expert_batch:
                yield "expert", dict(expert), stage


@pytest.mark.parametrize(("name", "preset"), CONFIGURATIONS)
def test_batches_hold_the_declared_fields_and_no_other(name: str, preset: str) -> None:
    method, config, needs, sight = view_of(name, preset)
    declared = {"offline": set(needs.offline), "expert": set(needs.expert)}
    parts = set()
    for part, batch, _ in batches(method, config, sight):
        assert set(batch) == declared[part]
        parts.add(part)
    assert parts, "a method draws something"


@pytest.mark.parametrize(("name", "preset"), CONFIGURATIONS)
def test_rewards_are_out_of_reach(name: str, preset: str) -> None:
    method, config, _, sight = view_of(name, preset)
    assert not holds(sight, REWARD)
    for _, batch, _ in batches(method, config, sight):
        assert not holds(batch, REWARD)


@pytest.mark.parametrize(("name", "preset"), CONFIGURATIONS)
def test_expert_actions_come_with_access_only(name: str, preset: str) -> None:
    method, config, _, sight = view_of(name, preset)
    sees = any(holds(batch, EXPERT_ACTION) for part, batch, _ in batches(method, config, sight) if part == "expert")
    assert holds(sight.expert, EXPERT_ACTION) == sees
    assert not sees or method.access_to_expert_actions


@pytest.mark.parametrize("name", [name for name in method_names() if not load_method(name).access_to_expert_actions])
def test_expert_actions_outside_the_mix_are_not_there_at_all(name: str) -> None:
    """The recipe puts K trajectories with their actions into the mix; with K = 0 no expert action has a place."""
    _, _, _, sight = view_of(name, "released", expert_trajectories=0)
    assert not holds(sight, EXPERT_ACTION)


def test_the_search_finds_what_there_is_to_find() -> None:
    """The published recipe itself puts the expert's actions into the mix; a search that missed them proves nothing."""
    _, _, _, sight = view_of("dilo", "released")
    assert holds(sight.offline, EXPERT_ACTION)
    _, _, _, sight = view_of("bc-expert", "released")
    assert holds(sight.expert, EXPERT_ACTION)


def test_a_method_cannot_change_the_data_that_others_see() -> None:
    _, _, _, sight = view_of("dilo", "released")
    row = torch.arange(4)[None]
    before = {field: value.clone() for field, value in sight.offline.batch(row).items()}
    for value in sight.offline.batch(row).values():
        value.fill_(-5.0)
    for field, value in sight.offline.batch(row).items():
        assert torch.equal(value, before[field])


class Cheat(Drifting):
    """Asks for expert actions and declares no access."""

    name = "cheat"
    wanted: Sequence[Field] = ("observation", "action")

    @classmethod
    def needs(cls, config: Any) -> DataNeeds:
        return DataNeeds(offline=("observation", "action"), expert=tuple(cls.wanted))


class Honest(Cheat):
    """Asks for the same, openly."""

    access_to_expert_actions = True


class AsksForTheExpertsStarts(Cheat):
    """`initial_observation` is a field of the offline data."""

    wanted = ("observation", "initial_observation")


def sight_of(method: type[Method]) -> View:
    offline, expert, recipe = poisoned(2)
    needs = method.needs(None)
    return view(method, needs, mix(offline, expert, recipe, needs, 9), CPU)


def test_reaching_for_expert_actions_without_access_is_refused() -> None:
    with pytest.raises(FirewallError, match=r"cheat.*expert actions"):
        sight_of(Cheat)
    assert set(sight_of(Honest).expert.fields) == {"observation", "action"}


def test_undeclarable_fields_are_refused() -> None:
    with pytest.raises(FirewallError, match="initial observations"):
        sight_of(AsksForTheExpertsStarts)


@pytest.mark.parametrize("field", ["reward", "is_expert"])
def test_fields_that_do_not_exist_are_not_served(field: str) -> None:
    class Curious(Drifting):
        name = "curious"

        @classmethod
        def needs(cls, config: Any) -> DataNeeds:
            return DataNeeds(offline=("observation", field), expert=("observation",))  # type: ignore[arg-type]

    try:
        sight = sight_of(Curious)
    except FirewallError as refusal:
        assert field in str(refusal)
    else:
        assert field not in sight.offline.fields
        pytest.fail(f"the declared field '{field}' is left out without a word")


DRAWS = ("policy: offline rows", "update: policy: offline rows", "order of the rows", "policy: expert rows")


@pytest.mark.parametrize("purpose", DRAWS)
def test_no_draw_tells_where_a_row_comes_from(purpose: str) -> None:
    """A method may guess the purpose of the engine's draws, and knows the seed and the step."""
    offline, expert = make_episodes([(9, False)] * 60), make_episodes([(9, False)] * 40, start=5_000)
    needs = DataNeeds(offline=("observation", "action"))
    sight = view(load_method("bc"), needs, mix(offline, expert, Recipe("random", 540, "expert", 30, 9), needs, 9), CPU)
    stage = Stage("policy", None, offline_batch=512, expert_batch=0)
    batch, _ = batches_at(StageSampler(sight, stage, Randomness([0])), 0)
    from_expert = batch["observation"][0, :, 0] >= 5_000
    assert 0.2 < from_expert.float().mean() < 0.5
    for guess in (
        Randomness([0]).uniform(purpose, 0, 512)[0],
        RunningStep(Draws(Randomness([0]), 1), 0).uniform(purpose, 512)[0],
    ):
        rank = guess.argsort().argsort().double()
        apart = (rank[from_expert].mean() - rank[~from_expert].mean()).abs() / 512.0
        assert apart < 0.1, (
            "the ranks of two parts drawn blindly differ by 0.03; by 0.5 where one lies behind the other"
        )


@pytest.mark.parametrize("name", method_names())
def test_nothing_tells_expert_rows_from_others(name: str) -> None:
    """A batch holds data values only: no index, no label; sizes and shapes are all else that a method gets."""
    method, config, needs, sight = view_of(name, "released")
    for part, batch, stage in batches(method, config, sight):
        rows = stage.offline_batch if part == "offline" else stage.expert_batch
        for field, value in batch.items():
            assert value.dtype == torch.float32
            assert value.shape[0] == 2
            assert value.shape[1] <= rows
            assert field in (*needs.offline, *needs.expert)
