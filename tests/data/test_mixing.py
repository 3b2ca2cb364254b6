"""Recipes against the readers' loops, and the counts of the published mixes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from raw_rows import (
    Raw,
    dilo_triples,
    endings,
    exact_triples,
    make_episodes,
    q_learning_view,
    released_mix,
    smodice_absorbing,
    sortable,
    values,
    walk,
)

from lfobench.contract.episodes import Episodes, concatenate
from lfobench.contract.method import Boundary, DataNeeds, Field, Termination
from lfobench.contract.suite import Recipe
from lfobench.data.boundaries import Rows
from lfobench.data.mixing import Mixture, mix

Ends = list[tuple[int, bool]]
TRIPLE: tuple[Field, ...] = ("observation", "next_observation", "second_next_observation")
PAIR: tuple[Field, ...] = ("observation", "next_observation")
HORIZON = 6


def recipe(trajectories: int, rows: int) -> Recipe:
    return Recipe("random", 1, "expert", trajectories, rows)


def mixed(offline: Episodes, expert: Episodes, needs: DataNeeds, trajectories: int = 2, rows: int = 8) -> Mixture:
    return mix(offline, expert, recipe(trajectories, rows), needs, HORIZON)


def parts(offline: Ends, expert: Ends) -> tuple[Episodes, Episodes]:
    return make_episodes(offline), make_episodes(expert, start=5_000)


@given(endings(), endings(), st.integers(0, 4))
def test_released_mix_of_transitions(offline_ends: Ends, expert_ends: Ends, trajectories: int) -> None:
    offline, expert = parts(offline_ends, expert_ends)
    found = mixed(offline, expert, DataNeeds(offline=PAIR, expert=PAIR), trajectories)
    rows = values(found.offline, found.observations, found.actions)
    assert rows == released_mix(offline, expert, trajectories, HORIZON)
    assert values(found.expert, found.observations, found.actions) == q_learning_view(expert)[:8]


@given(endings(), endings(), st.integers(0, 4))
def test_released_mix_of_triples(offline_ends: Ends, expert_ends: Ends, trajectories: int) -> None:
    offline, expert = parts(offline_ends, expert_ends)
    found = mixed(offline, expert, DataNeeds(offline=TRIPLE, expert=TRIPLE), trajectories)
    rows = values(found.offline, found.observations, found.actions)
    assert rows == dilo_triples(released_mix(offline, expert, trajectories, HORIZON))
    demonstration = dilo_triples(q_learning_view(expert))[:8]
    sampled = values(found.expert, found.observations, found.actions)[: found.expert.sampled]
    assert sampled == demonstration[:-1], "the authors' buffer never samples its last row"


@pytest.mark.parametrize("termination", ["zero", "absorbing"])
@given(offline_ends=endings(), expert_ends=endings(), trajectories=st.integers(0, 4))
def test_exact_mix_of_triples(
    termination: Termination, offline_ends: Ends, expert_ends: Ends, trajectories: int
) -> None:
    offline, expert = parts(offline_ends, expert_ends)
    needs = DataNeeds(offline=TRIPLE, expert=TRIPLE, boundary="exact", termination=termination)
    found = mixed(offline, expert, needs, trajectories)
    expected = exact_triples(offline, termination) + exact_triples(expert.first_episodes(trajectories), termination)
    assert sortable(values(found.offline, found.observations, found.actions)) == sortable(expected)
    demonstration = exact_triples(expert.first_episodes(1), termination)
    assert sortable(values(found.expert, found.observations, found.actions)) == sortable(demonstration)
    assert found.offline.sampled == len(found.offline), "unlike the released ones, these absorbing rows are drawn"
    assert found.transform.size == 2 + (termination == "absorbing")


@given(endings(), endings(), st.integers(0, 4))
def test_smodice_absorbing_rows(offline_ends: Ends, expert_ends: Ends, trajectories: int) -> None:
    offline, expert = parts(offline_ends, expert_ends)
    needs = DataNeeds(offline=(*PAIR, "terminated"), expert=("observation",), termination="absorbing")
    found = mixed(offline, expert, needs, trajectories)
    rows = values(found.offline, found.observations, found.actions)
    sampled, appended = smodice_absorbing(released_mix(offline, expert, trajectories, HORIZON))
    assert found.offline.sampled == len(sampled), "appended rows are never drawn for training (quirk 1)"
    assert rows == sampled + appended


@given(endings(), endings())
def test_initial_observations_start_episodes_of_the_mix(offline_ends: Ends, expert_ends: Ends) -> None:
    offline, expert = parts(offline_ends, expert_ends)
    found = mixed(offline, expert, DataNeeds(offline=(*PAIR, "initial_observation"), expert=PAIR), 2)
    firsts = [states[0] for states, _, _ in walk(concatenate([offline, expert]))]
    in_the_mix = {row.observation for row in released_mix(offline, expert, 2, HORIZON)}
    expected = [first for first in firsts if first in in_the_mix]
    assert [tuple(map(float, found.observations[index])) for index in found.initial] == expected


@given(endings(2), endings(2), st.sampled_from(["teleport", "absorbing"]))
def test_standardisation_uses_the_mix_that_is_sampled(
    offline_ends: Ends, expert_ends: Ends, termination: Termination
) -> None:
    offline, expert = parts(offline_ends, expert_ends)
    needs = DataNeeds(offline=PAIR, expert=PAIR, termination=termination, standardize=True)
    seen = np.array([row.observation for row in released_mix(offline, expert, 2, HORIZON)])
    if len(seen) == 0:
        return
    found = mixed(offline, expert, needs)
    raw = concatenate([offline, expert]).observations
    scale = seen.std(0) + 1e-10
    expected = (raw - seen.mean(0)) / scale
    if np.all(seen.std(0) > 0):
        np.testing.assert_allclose(found.observations[: len(raw), :2], expected, rtol=1e-3, atol=1e-3)
        np.testing.assert_array_equal(found.transform(raw), found.observations[: len(raw)])
    if termination == "absorbing":
        assert found.observations[-1].tolist() == [0.0, 0.0, 1.0], "the absorbing observation is not shifted"


def test_halfcheetah_random_expert_by_the_numbers() -> None:
    """998,000 + 199,798 triples; the demonstration has 999 rows."""
    offline = make_episodes([(1000, False)] * 1000, width=1)
    expert = make_episodes([(1000, False)] * 202, start=2_000_000, width=1)
    found = mix(offline, expert, recipe(200, 1000), DataNeeds(offline=TRIPLE, expert=TRIPLE), 1000)
    assert found.offline.sampled == 1_197_798
    assert found.expert.sampled == 999


@pytest.mark.parametrize(
    ("horizon", "kept", "sampled"), [(1000, 1000, 999), (200, 200, 199), (100, 100, 99), (280, 183, 182)]
)
def test_rows_of_the_demonstration(horizon: int, kept: int, sampled: int) -> None:
    """Parity item 4: locomotion, door and hammer, pen by the same rule, kitchen."""
    expert = make_episodes([(horizon, False)] * 6, start=20_000)
    offline = make_episodes([(horizon, False)] * 3)
    found = mix(offline, expert, recipe(4, kept), DataNeeds(offline=TRIPLE, expert=TRIPLE), horizon)
    demonstrated = values(found.expert, found.observations, found.actions)
    assert len(demonstrated) == found.expert.sampled == sampled
    inside = set(values(found.offline, found.observations, found.actions))
    assert set(demonstrated) <= inside, "the demonstrated rows, with their actions, are in the mix"


def test_the_time_limited_demonstration_spills_into_the_second_episode() -> None:
    expert = make_episodes([(1000, False)] * 4, start=20_000)
    found = mix(make_episodes([(9, False)]), expert, recipe(2, 1000), DataNeeds(TRIPLE, TRIPLE), 1000)
    second_episode = set(walk(expert)[1][0])
    rows = values(found.expert, found.observations, found.actions)
    assert [row.observation in second_episode for row in rows] == [False] * 998 + [True]


def rows_of(found: Mixture, part: Rows) -> list[Raw]:
    return values(part, found.observations, found.actions)


def test_trajectories_that_are_not_reached_join_as_far_as_they_are_there() -> None:
    """For every method, whether its boundaries are released or exact."""
    offline, expert = parts([(6, False)] * 3, [(4, False)] * 2)
    found = mixed(offline, expert, DataNeeds(PAIR, PAIR), trajectories=3)
    assert rows_of(found, found.offline) == q_learning_view(offline) + q_learning_view(expert)
    found = mixed(offline, expert, DataNeeds(PAIR, PAIR, boundary="exact", termination="zero"), trajectories=3)
    assert len(found.offline) == 3 * 6 + 2 * 4


@pytest.mark.parametrize("boundary", ["released", "exact"])
@pytest.mark.parametrize("fields", [PAIR, TRIPLE])
def test_a_method_without_the_expert_s_trajectories_has_the_same_demonstration(
    boundary: Boundary, fields: tuple[Field, ...]
) -> None:
    offline, expert = parts([(6, False), (4, True)], [(6, False), (5, True)])
    termination: Termination = "teleport" if boundary == "released" else "zero"
    needs = DataNeeds(fields, fields, boundary=boundary, termination=termination)
    found, apart = mixed(offline, expert, needs), mixed(offline, expert, replace(needs, expert_joins=False))
    assert rows_of(apart, apart.expert) == rows_of(found, found.expert)
    none = mixed(offline, expert, needs, trajectories=0)
    assert rows_of(apart, apart.offline) == rows_of(none, none.offline)
    assert all(row.observation[0] < 5_000 for row in rows_of(apart, apart.offline))
    assert any(row.observation[0] >= 5_000 for row in rows_of(found, found.offline))


def states_of(found: Mixture, part: Rows) -> set[float]:
    """Every observation that a part's rows lead through."""
    rows = rows_of(found, part)
    return {state[0] for row in rows for state in (row.observation, row.next_observation, row.second) if state}


@given(
    endings(longest=7), st.lists(st.tuples(st.integers(3, 7), st.booleans()), min_size=1, max_size=5), st.integers(1, 6)
)
def test_demonstrations_counted_in_trajectories_are_the_same_for_every_method(
    offline_ends: Ends, expert_ends: Ends, demonstrations: int
) -> None:
    """No method sees a step beyond them; released readers lose their last steps, as they do anywhere."""
    offline, expert = parts(offline_ends, expert_ends)
    counted = Recipe("random", 1, "expert", 2, demonstrations=demonstrations)
    whole = {state[0] for states, _, _ in walk(expert)[:demonstrations] for state in states}
    seen: dict[str, set[float]] = {}
    for fields in (PAIR, TRIPLE):
        for boundary, termination in (("released", "teleport"), ("exact", "zero")):
            needs = DataNeeds(fields, fields, boundary=boundary, termination=termination)  # type: ignore[arg-type]
            found = mix(offline, expert, counted, needs, HORIZON)
            seen[f"{boundary} {len(fields)}"] = states_of(found, found.expert)
    assert seen["exact 2"] == seen["exact 3"] == whole
    assert seen["released 3"] <= seen["released 2"] <= whole
    # Two steps of a timed-out trajectory's end are not in a released reader's rows.
    assert len(whole - seen["released 3"]) <= 3 * demonstrations


def test_trajectories_of_200_steps_are_as_many_for_everybody() -> None:
    """The case of a user's own files: rows gave one method five of these and another a single one."""
    offline, expert = parts([(6, False)], [(200, False)] * 8)
    for demonstrations in (1, 3):
        counted = Recipe("random", 1, "expert", 2, demonstrations=demonstrations)
        for fields, released, exact in ((PAIR, 199, 200), (TRIPLE, 198, 199)):
            found = mix(offline, expert, counted, DataNeeds(fields, fields), 1000)
            assert found.expert.sampled == demonstrations * released
            needs = DataNeeds(fields, fields, boundary="exact", termination="zero")
            assert mix(offline, expert, counted, needs, 1000).expert.sampled == demonstrations * exact


@pytest.mark.parametrize("boundary", ["released", "exact"])
@pytest.mark.parametrize("termination", ["teleport", "zero", "absorbing"])
@pytest.mark.parametrize("fields", [PAIR, TRIPLE])
def test_no_declaration_is_served_with_something_else(
    boundary: str, termination: str, fields: tuple[Field, ...]
) -> None:
    """Every combination either gives valid rows of every declared field, or is refused by name."""
    offline, expert = parts([(6, False), (4, True), (5, False)], [(6, False), (3, True), (6, False)])
    needs = DataNeeds(fields, fields, boundary=boundary, termination=termination)  # type: ignore[arg-type]
    triples = "second_next_observation" in fields
    rules = {("released", "teleport"), ("exact", "zero"), ("exact" if triples else "released", "absorbing")}
    if (boundary, termination) not in rules:
        with pytest.raises(ValueError, match=rf"{boundary} (pairs|triples) .*'{termination}'"):
            mixed(offline, expert, needs)
        return
    found = mixed(offline, expert, needs)
    for rows in (found.offline, found.expert):
        indices = [rows.observation, rows.next_observation]
        if triples:
            assert rows.second_next_observation is not None
            indices.append(rows.second_next_observation)
        for index in indices:
            assert index.min() >= 0
            assert index.max() < len(found.observations)
    ends = {states[-1] for states, _, terminated in walk(offline) if terminated}
    seen = {tuple(map(float, row[:2])) for row in found.observations[found.offline.next_observation]}
    assert bool(ends & seen) == (boundary == "exact"), "true terminal successors are the exact boundary's"
    last = found.offline.second_next_observation if triples else found.offline.next_observation
    assert last is not None
    absorbing = len(offline.observations) + len(expert.observations)
    assert bool((last == absorbing).any()) == (termination == "absorbing")
