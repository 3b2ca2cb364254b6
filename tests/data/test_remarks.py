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


def said(expert: Sequence[int], trajectories: int, returns: Sequence[float] | None = None) -> str:
    """Remarks on expert episodes of these lengths, and of returns that are said or 0."""
    episodes = make_episodes(expert, [True] * len(expert), 11, 3)
    episodes.rewards[:] = 0.0
    if returns is not None:
        episodes.rewards[episodes.first_transition] = returns
    recipe = Recipe("random", 30, "expert", trajectories, 1)
    offline = make_episodes([30], [True], 11, 3)
    data = TaskData(replace(SUITE.tasks[0], recipe=recipe), recipe, offline, episodes, {})
    return " ".join(remark.what for remark in remarks(data, NEEDS))


@pytest.mark.parametrize(("episodes", "mixed"), [(2, False), (3, False), (4, True)])
def test_trajectories_that_are_not_reached(episodes: int, mixed: bool) -> None:
    text = said([5] * episodes, 3)
    assert ("none of it is mixed into the offline data" in text) == (not mixed)


def test_who_wants_no_trajectory_lacks_none() -> None:
    assert said([5, 5], 0) == ""


def test_a_demonstration_is_poor_only_beside_enough_others() -> None:
    assert said([5] * 4, 0, [0.0, 900.0, 900.0, 900.0]) == ""
    many = said([5] * 12, 0, [0.0, *[900.0] * 11])
    assert many.startswith("The demonstration of hopper-random-expert, the first expert episode, scores 0.6; ")
    assert said([5] * 12, 0, [900.0] * 12) == ""
