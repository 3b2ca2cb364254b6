"""What is said of data that are not as their recipe has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from helpers_files import make_episodes

from lfobench.contract.method import DataNeeds
from lfobench.contract.suite import Recipe
from lfobench.data.remarks import remarks
from lfobench.data.source import TaskData
from suites.locomotion import SUITE

NEEDS = DataNeeds(offline=("observation", "action"), expert=("observation",))


def remarks_on(
    expert: Sequence[int], trajectories: int, returns: Sequence[float] | None = None, counted: Recipe | None = None
) -> str:
    """Remarks on expert episodes of these lengths, and of returns that are said or 0."""
    episodes = make_episodes(expert, [True] * len(expert), 11, 3)
    episodes.rewards[:] = 0.0
    if returns is not None:
        episodes.rewards[episodes.first_transition] = returns
    recipe = counted or Recipe("random", 30, "expert", trajectories, 1)
    offline = make_episodes([30], [True], 11, 3)
    data = TaskData(replace(SUITE.tasks[0], recipe=recipe), recipe, offline, episodes, {})
    return " ".join(remark.what for remark in remarks(data, NEEDS))


@pytest.mark.parametrize(("episodes", "short"), [(1, True), (2, True), (3, False), (4, False)])
def test_trajectories_that_are_not_reached(episodes: int, short: bool) -> None:
    text = remarks_on([5] * episodes, 3)
    assert ("of the 3 " in text) == short
    assert not short or f"has {episodes} trajector" in text


def test_a_recipe_without_joining_trajectories_lacks_none() -> None:
    assert remarks_on([5, 5], 0) == ""


def test_a_demonstration_is_poor_only_among_enough_others() -> None:
    assert remarks_on([5] * 4, 0, [0.0, 900.0, 900.0, 900.0]) == ""
    many = remarks_on([5] * 12, 0, [0.0, *[900.0] * 11])
    assert "demonstration of hopper-random-expert" in many and " 0.6;" in many
    assert remarks_on([5] * 12, 0, [900.0] * 12) == ""


def test_demonstrations_that_are_not_there() -> None:
    counted = Recipe("random", 30, "expert", 0, demonstrations=4)
    assert "expert part of hopper-random-expert has 3 of the 4 " in remarks_on([5] * 3, 0, counted=counted)
    assert remarks_on([5] * 4, 0, counted=counted) == ""


def test_recordings_that_are_not_there() -> None:
    """As files can lack them; an equal share is counted in transitions."""
    recorded = Recipe.recorded("random", 2, "expert", 3)
    text = remarks_on([5] * 3, 0, counted=recorded)
    assert "offline part of hopper-random-expert has 1 of the 2 " in text
    assert "expert part" not in text
    assert remarks_on([5] * 3, 0, counted=replace(recorded, equal_transitions=True)) == ""
    short = remarks_on([5] * 9, 0, counted=replace(recorded, equal_transitions=True, demonstrations=9))
    assert "has 30 of the 45 " in short


def test_rows_that_span_several_trajectories_are_a_remark() -> None:
    assert "10 rows" in remarks_on([5] * 6, 0, counted=Recipe("random", 30, "expert", 0, 10))
    assert remarks_on([5] * 6, 0, counted=Recipe("random", 30, "expert", 0, 9)) == ""
