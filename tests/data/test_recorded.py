"""Recipes of recorded trajectories: rows against plain loops over every episode, and parts that operators record."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from raw_rows import endings, make_episodes, values, walk

from lfobench.contract.episodes import Episodes
from lfobench.contract.method import DataNeeds, Field
from lfobench.contract.suite import Environment, Task, TrajectoryRecipe
from lfobench.data.generated import record
from lfobench.data.manifest import manifest
from lfobench.data.mixing import Mixture, mix
from lfobench.data.source import TaskData
from lfobench.errors import UserError
from lfobench.plan.parts import PartSpecification

TRIPLE: tuple[Field, ...] = ("observation", "next_observation", "second_next_observation")
PAIR: tuple[Field, ...] = ("observation", "next_observation")
Ends = list[tuple[int, bool]]


def recipe(sample: int | None = None) -> TrajectoryRecipe:
    return TrajectoryRecipe("suboptimal", 1, "expert", 1, expert_transitions=sample)


def mixed(offline: Ends, expert: Ends, fields: tuple[Field, ...], sample: int | None = None) -> Mixture:
    needs = DataNeeds(offline=fields, expert=fields)
    return mix(make_episodes(offline), make_episodes(expert, start=5_000), recipe(sample), needs, 6)


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
    with pytest.raises(UserError, match="samples 9 expert transitions; its trajectories hold 8"):
        mixed([(4, False)], [(5, False), (5, False)], TRIPLE, 9)


def test_offline_rows_hold_nothing_of_the_demonstrations() -> None:
    found = mixed([(4, False), (7, True)], [(5, False)], TRIPLE)
    assert all(row[0][0] < 5_000 for row in seen(found, "offline"))  # type: ignore[index]


class Counting:
    """Records as many episodes as it is told to, or one fewer."""

    fingerprint = "counting"

    def __init__(self, short: int = 0) -> None:
        self.short = short

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        return make_episodes([(int(generator.integers(3, 9)), False) for _ in range(episodes - self.short)])


def specification(episodes: int = 4, operator: str = "counting") -> PartSpecification:
    environment = Environment("reach", "Reach-v0", 9, 0.0, 1.0, {"score": "touch"})
    return PartSpecification(environment, "expert", operator, (("mujoco", "1"),), 0, episodes=episodes)


def test_a_recording_is_a_function_of_its_specification() -> None:
    first, again = record(specification(), Counting()), record(specification(), Counting())
    assert first.lengths.tolist() == again.lengths.tolist()
    assert first.lengths.tolist() != record(specification(operator="another"), Counting()).lengths.tolist()


def test_a_recording_is_shared_by_tasks_that_only_score_differently() -> None:
    one = specification()
    other = replace(one, environment=replace(one.environment, id="Reach-v1", arguments={"score": "hit"}))
    assert one.hash == other.hash
    assert one.hash != specification(5).hash


def test_an_operator_that_records_too_little_is_named() -> None:
    with pytest.raises(ValueError, match="asked for 4 episodes and recorded 3"):
        record(specification(), Counting(short=1))


def test_the_manifest_says_what_is_observed() -> None:
    offline, expert = make_episodes([(6, False)] * 3), make_episodes([(6, False)] * 2, start=5_000)
    environment = Environment("reach", "Reach-v0", 9, 0.0, 1.0)
    task = Task("reach-few", "few", environment, recipe(5), 10)
    counted = manifest(TaskData(task, recipe(5), offline, expert, {"offline": "a", "expert": "b"}))
    words = "\n".join(counted.sentences())
    assert "3 episodes, 18 transitions" in words
    assert "offline triples: 15" in words
    assert "5 observation triples, drawn uniformly" in words
