"""Recipes of recorded trajectories: rows against plain loops over every episode; parts of scripted demonstrators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from raw_rows import endings, make_episodes, values, walk
from scene_suite import REACH
from scene_suite import SUITE as SCENES

from lfobench.cells.parts import PartSpecification, requests
from lfobench.contract.episodes import Episodes, FloatArray
from lfobench.contract.method import DataNeeds, Field
from lfobench.contract.suite import Environment, Recipe, Task
from lfobench.data.build import record
from lfobench.data.cache import PartCache
from lfobench.data.manifest import manifest
from lfobench.data.mixing import Mixture, mix
from lfobench.data.source import TaskData, load_task
from lfobench.errors import UserError

TRIPLE: tuple[Field, ...] = ("observation", "next_observation", "second_next_observation")
PAIR: tuple[Field, ...] = ("observation", "next_observation")
Ends = list[tuple[int, bool]]


def recipe(sample: int | None = None, demonstrations: int = 1) -> Recipe:
    return Recipe.recorded("suboptimal", 1, "expert", demonstrations, expert_transitions=sample)


def mixed(offline: Ends, expert: Ends, fields: tuple[Field, ...], sample: int | None = None) -> Mixture:
    needs = DataNeeds(offline=fields, expert=fields)
    return mix(make_episodes(offline), make_episodes(expert, start=5_000), recipe(sample, len(expert)), needs, 6)


def plain_triples(episodes: Episodes) -> list[tuple[object, ...]]:
    """Every three successive observations of an episode; a terminal step repeats its last."""
    found: list[tuple[object, ...]] = []
    for observations, _, terminated in walk(episodes):
        found += list(zip(observations, observations[1:], observations[2:], strict=False))
        if terminated:
            found.append((observations[-2], observations[-1], observations[-1]))
    return found


def seen(mixture: Mixture, part: str) -> list[tuple[object, ...]]:
    rows = getattr(mixture, part)
    return [
        (raw.observation, raw.next_observation) + (() if raw.second is None else (raw.second,))
        for raw in values(rows, mixture.observations, mixture.actions)
    ]


@given(endings(), endings())
def test_every_triple_of_both_parts_is_there_once_and_none_crosses_an_end(offline: Ends, expert: Ends) -> None:
    found = mixed(offline, expert, TRIPLE)
    assert sorted(seen(found, "offline")) == sorted(plain_triples(make_episodes(offline)))
    assert sorted(seen(found, "expert")) == sorted(plain_triples(make_episodes(expert, start=5_000)))


@given(endings(), endings())
def test_every_pair_of_both_parts_is_there_once(offline: Ends, expert: Ends) -> None:
    found = mixed(offline, expert, PAIR)
    for part, episodes in (("offline", make_episodes(offline)), ("expert", make_episodes(expert, start=5_000))):
        pairs = [pair for observations, _, _ in walk(episodes) for pair in pairwise(observations)]
        assert seen(found, part) == pairs


@given(st.lists(st.tuples(st.integers(3, 9), st.just(False)), min_size=2, max_size=6), st.integers(1, 4))
def test_a_sample_is_one_set_of_rows_for_every_method(expert: Ends, size: int) -> None:
    triples, pairs = mixed([(4, False)], expert, TRIPLE, size), mixed([(4, False)], expert, PAIR, size)
    drawn = seen(triples, "expert")
    assert len(set(drawn)) == size
    assert set(drawn) <= set(plain_triples(make_episodes(expert, start=5_000)))
    assert [row[:2] for row in drawn] == seen(pairs, "expert")


def test_a_sample_is_in_no_order() -> None:
    rows = [row[0] for row in seen(mixed([(4, False)], [(200, False)], TRIPLE, 150), "expert")]
    steps = np.diff(np.array(rows)[:, 0])
    assert 50 < np.count_nonzero(steps < 0) < 100


def test_a_sample_larger_than_the_recordings_is_refused() -> None:
    with pytest.raises(UserError, match=r" 9 expert transitions.* 8 .*expert_transitions"):
        mixed([(4, False)], [(5, False), (5, False)], TRIPLE, 9)


def test_offline_rows_hold_nothing_of_the_demonstrations() -> None:
    found = mixed([(4, False), (7, True)], [(5, False)], TRIPLE)
    assert all(row[0][0] < 5_000 for row in seen(found, "offline"))  # type: ignore[index]


class Counting:
    """Records as many episodes as it is told to, or fewer, or with something wrong in them."""

    fingerprint = "counting"

    def __init__(self, short: int = 0, **wrong: Any) -> None:
        self.short, self.wrong = short, wrong

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        made = make_episodes([(int(generator.integers(3, 9)), False) for _ in range(episodes - self.short)])
        made = replace(made, actions=np.zeros((made.transitions, 2), np.float32))
        return replace(made, **{name: change(getattr(made, name)) for name, change in self.wrong.items()})


def with_first(value: float) -> Callable[[FloatArray], FloatArray]:
    """A change of an array's very first entry."""

    def change(array: FloatArray) -> FloatArray:
        array = array.copy()
        array.reshape(-1)[0] = value
        return array

    return change


def specification(episodes: int = 4, demonstrator: str = "counting") -> PartSpecification:
    return PartSpecification(REACH, "expert", demonstrator, (("mujoco", "1"),), 0, episodes=episodes)


def test_a_recording_is_a_function_of_its_specification() -> None:
    first, again = record(specification(), Counting()), record(specification(), Counting())
    assert first.lengths.tolist() == again.lengths.tolist()
    assert first.lengths.tolist() != record(specification(demonstrator="another"), Counting()).lengths.tolist()


def test_a_recording_is_shared_by_tasks_that_only_score_differently() -> None:
    one = specification()
    other = replace(one, environment=replace(one.environment, id="Reach-v1", arguments={"puck": True}))
    assert one.hash == other.hash
    assert one.hash != specification(5).hash


def test_a_demonstrator_that_records_too_little_is_named() -> None:
    with pytest.raises(ValueError, match=r" 4 episodes.* 3"):
        record(specification(), Counting(short=1))


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"observations": lambda rows: rows[:, :1]}, r"observations.* \(1,\).* \(2,\)"),
        ({"actions": lambda rows: np.repeat(rows, 2, 1)}, r"actions.* \(4,\)"),
        ({"observations": with_first(np.nan)}, "observations.*finite"),
        ({"rewards": with_first(np.inf)}, "rewards.*finite"),
        ({"actions": with_first(np.nan)}, r"actions.* \[-1, 1\]"),
        ({"actions": with_first(1.5)}, r"actions.* \[-1, 1\]"),
    ],
)
def test_a_recording_that_its_environment_would_not_make_is_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        record(specification(), Counting(**wrong))


def test_parts_without_actions_are_known_before_anything_is_trained(tmp_path: Path, shared_cache: Path) -> None:
    def nothing(rows: FloatArray) -> FloatArray:
        return np.full_like(rows, np.nan)

    silent_demonstrator = Counting(actions=nothing)
    assert np.isnan(record(specification(), silent_demonstrator).actions).all()
    silent = replace(SCENES, demonstrator=lambda environment, level: silent_demonstrator)
    for request in requests(silent, silent.tasks[0], silent.tasks[0].recipe):
        PartCache(tmp_path, request.specification).write(0, record(request.specification, silent_demonstrator))
    with pytest.raises(UserError, match=r"random part of reach-few .*actions.*expert_actions=False"):
        load_task(tmp_path, silent, silent.tasks[0], silent.tasks[0].recipe, "build")


@given(endings(2), endings(2), st.sampled_from([PAIR, TRIPLE]))
def test_every_method_sees_the_same_standardised_observations(
    offline: Ends, expert: Ends, fields: tuple[Field, ...]
) -> None:
    """By the moments of the offline rows, whatever the method declares."""
    needs = DataNeeds(offline=fields, expert=fields)
    made = make_episodes(offline), make_episodes(expert, start=5_000)
    found = mix(*made, replace(recipe(), standardize=True), needs, 6)
    plain = mix(*made, recipe(), needs, 6)
    drawn = plain.observations[plain.offline.observation].astype(np.float64)
    np.testing.assert_allclose(found.transform.shift, drawn.mean(0), rtol=1e-5)
    np.testing.assert_allclose(found.transform.scale, drawn.std(0), rtol=1e-4, atol=1e-9)
    np.testing.assert_array_equal(found.observations, found.transform(plain.observations))


def test_the_manifest_counts_the_observed_rows() -> None:
    offline, expert = make_episodes([(6, False)] * 3), make_episodes([(6, False)] * 2, start=5_000)
    environment = Environment("reach", "Reach-v0", 9, 0.0, 1.0)
    task = Task("reach-few", "few", environment, recipe(5, 2), 10)
    counted = manifest(TaskData(task, recipe(5, 2), offline, expert, {"offline": "a", "expert": "b"}))
    text = "\n".join(counted.sentences())
    assert "3 episodes, 18 transitions" in text
    assert "15" in text
    assert "5 observation triples" in text
