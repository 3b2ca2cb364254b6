"""The suite by its numbers, and the demonstrations that its seeds choose."""

from __future__ import annotations

import json

import pytest

from lfobench.cells.parts import specification
from lfobench.contract.suite import Environment, Task
from lfobench.data.build import roll_out
from suites.demonstrators import WEIGHTS
from suites.locomotion import ENVIRONMENTS, SMODICE, SUITE

# environment: id, observation, action, return of score 0, return of score 100
PUBLISHED = {
    "hopper": ("Hopper-v5", 11, 3, -20.272305, 3234.3),
    "halfcheetah": ("HalfCheetah-v5", 17, 6, -280.178953, 12135.0),
    "walker2d": ("Walker2d-v5", 17, 6, 1.629008, 4592.3),
    "ant": ("Ant-v5", 27, 8, -325.6, 3879.7),
}
# mix: expert trajectories, gradient steps
MIXES = {"expert": (200, 300_000), "few-expert": (30, 500_000)}


def by_environment(name: str) -> Environment:
    return next(environment for environment in ENVIRONMENTS if environment.name == name)


def test_sixteen_tasks_in_the_order_of_the_published_table() -> None:
    assert [task.name for task in SUITE.tasks] == [
        f"{name}-{offline}-{mix}" for offline in ("random", "medium") for mix in MIXES for name in PUBLISHED
    ]


@pytest.mark.parametrize("task", SUITE.tasks, ids=lambda task: task.name)
def test_a_task_is_the_published_recipe(task: Task) -> None:
    name, offline, mix = task.name.split("-", maxsplit=2)
    trajectories, steps = MIXES[mix]
    environment, recipe = task.environment, task.recipe
    assert (environment.name, environment.horizon) == (name, 1000)
    assert (environment.id, environment.random_return, environment.expert_return) == (
        PUBLISHED[name][0],
        *PUBLISHED[name][3:],
    )
    assert (recipe.offline, recipe.offline_transitions) == (offline, 1_000_000)
    assert (recipe.expert, recipe.expert_trajectories, recipe.demonstration_rows) == ("expert", trajectories, 1000)
    assert (task.group, task.paper_steps) == (f"{offline}+{mix}", steps)


def test_smodice_s_code_mixes_half_as_many_trajectories_for_walker2d() -> None:
    changed = {task.name: task.recipe for task, other in zip(SMODICE.tasks, SUITE.tasks, strict=True) if task != other}
    assert list(changed) == ["walker2d-random-expert", "walker2d-medium-expert"]
    assert {recipe.expert_trajectories for recipe in changed.values()} == {100}


@pytest.mark.parametrize("name", PUBLISHED)
def test_an_environment_has_the_published_shape(name: str) -> None:
    simulator = by_environment(name).make()
    assert simulator.observation_space.shape == (PUBLISHED[name][1],)
    assert simulator.action_space.shape == (PUBLISHED[name][2],)
    simulator.close()


def test_scores_are_those_of_the_parity_checklist() -> None:
    hopper = by_environment("hopper")
    assert hopper.normalized_score(3234.3) == pytest.approx(100.0)
    assert hopper.normalized_score(-20.272305) == pytest.approx(0.0)


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_demonstration_is_an_expert_episode_to_the_horizon(name: str) -> None:
    """On every processor: a lone fall must not be what every method is asked to imitate."""
    task = next(task for task in SUITE.tasks if task.environment.name == name)
    level = json.loads((WEIGHTS / f"{name}-expert.json").read_text(encoding="utf-8"))["levels"]["sampled"]
    part = specification(SUITE, task, "expert")
    episodes = roll_out(part, SUITE.demonstrator(name, "expert"), 0, transitions=1)
    score = task.environment.normalized_score(float(episodes.returns()[0]))
    assert episodes.lengths.tolist() == [1000]
    assert abs(score - level["score_mean"]) <= level["score_std"]
