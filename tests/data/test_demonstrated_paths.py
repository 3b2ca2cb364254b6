"""Demonstrated paths: the demonstration as lines, whole trajectories or the transitions that a recipe samples."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scene_suite
from scene_suite import SUITE

from lfobench.contract.suite import Recipe
from lfobench.data.source import TaskData, demonstrated_paths


def demonstrated(transitions: int | None, standardize: bool = False) -> tuple[TaskData, list[np.ndarray]]:
    recipe = Recipe.recorded("random", 2, "expert", 3, expert_transitions=transitions, standardize=standardize)
    task = replace(SUITE.tasks[0], recipe=recipe)
    offline, expert = (
        scene_suite.Hand("strike", level).record(count, np.random.default_rng(seed))
        for seed, (level, count) in enumerate((("random", 2), ("expert", 3)))
    )
    data = TaskData(task, recipe, offline, expert, {})
    return data, demonstrated_paths(data, slice(0, 2))


@pytest.mark.parametrize("standardize", [False, True])
def test_a_trajectory_is_one_line_through_all_its_observations(standardize: bool) -> None:
    """In the simulator's units, also where methods see standardised observations."""
    data, found = demonstrated(None, standardize)
    expert = data.expert
    assert len(found) == 3
    for line, first, length in zip(found, expert.first_observation, expert.lengths, strict=True):
        np.testing.assert_array_equal(line, expert.observations[first : first + length + 1, :2])


def test_sampled_transitions_are_lines_between_neighbours() -> None:
    data, found = demonstrated(12)
    expert = data.expert
    assert sum(len(line) - 1 for line in found) == 12
    followers = {
        tuple(expert.observations[row, :2]): tuple(expert.observations[row + 1, :2])
        for first, length in zip(expert.first_observation, expert.lengths, strict=True)
        for row in range(first, first + length)
    }
    for line in found:
        for here, there in pairwise(line):
            assert followers[tuple(here)] == tuple(there)
