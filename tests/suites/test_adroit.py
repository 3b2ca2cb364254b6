"""The suite by its numbers, and the demonstrations that its seeds choose."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from lfobench.cells.parts import specification
from lfobench.cells.sources import nowhere, read_from
from lfobench.contract.suite import Recipe, Task
from lfobench.data.build import roll_out
from suites.adroit import ENVIRONMENTS, PAPER, SUITE
from suites.hand.levels import WEIGHTS, demonstrator

# environment: observation, action, horizon, return of score 0, return of score 100
PUBLISHED = {
    "pen": (45, 24, 100, 96.262799, 3076.8331017826877),
    "door": (39, 28, 200, -56.512833, 2880.5693087298737),
    "hammer": (46, 26, 200, -274.856578, 12794.134825156867),
}
TRANSITIONS = {
    "pen-cloned-expert": 500_000,
    "door-cloned-expert": 1_000_000,
    "hammer-cloned-expert": 1_000_000,
    "pen-human-expert": 5_000,
    "door-human-expert": 6_729,
    "hammer-human-expert": 11_310,
}

each_task = pytest.mark.parametrize("task", SUITE.tasks, ids=lambda task: task.name)
each_environment = pytest.mark.parametrize("environment", ENVIRONMENTS, ids=lambda environment: environment.name)


def test_six_tasks_in_the_order_of_the_published_table() -> None:
    assert [task.name for task in SUITE.tasks] == list(TRANSITIONS)
    assert [task.group for task in SUITE.tasks] == ["cloned+expert"] * 3 + ["scripted+expert"] * 3


@each_task
def test_a_task_is_the_published_recipe(task: Task) -> None:
    name, offline, _ = task.name.split("-")
    horizon = PUBLISHED[name][2]
    made = "scripted" if offline == "human" else offline
    assert task.recipe == Recipe(made, TRANSITIONS[task.name], "expert", 30, horizon), "what nobody did is not human"
    assert task.paper_steps == 500_000


@each_task
@pytest.mark.parametrize("source", ["d4rl", "minari"])
def test_real_files_are_called_what_they_are(task: Task, source: str) -> None:
    name, offline, _ = task.name.split("-")
    [real] = read_from([task], source, None, nowhere)
    assert real.recipe.offline == offline
    assert real.recipe.offline_transitions == TRANSITIONS[task.name]
    assert real.environment == task.environment
    assert real.group == f"{offline}+expert"
    assert real.read_from is not None and real.read_from.offline is not None and real.read_from.expert is not None
    version = "v0" if source == "d4rl" else "v2"
    names = [real.read_from.offline.name, real.read_from.expert.name]
    prefix = "" if source == "d4rl" else "D4RL-"
    assert names == [f"{prefix}{name}-{level}-{version}" for level in (offline, "expert")]


def test_the_paper_s_horizon_ends_everything_at_100() -> None:
    for task, other in zip(SUITE.tasks, PAPER.tasks, strict=True):
        assert other.environment == replace(task.environment, horizon=100)
        assert other.recipe == replace(task.recipe, demonstration_rows=100)
        [real] = read_from([other], "d4rl", None, nowhere)
        assert (real.environment.horizon, real.recipe.demonstration_rows) == (100, 100)


@each_environment
def test_an_environment_has_the_published_shape(environment) -> None:
    simulator = environment.make()
    columns, actions, horizon, *returns = PUBLISHED[environment.name]
    assert simulator.observation_space.shape == (columns,)
    assert simulator.action_space.shape == (actions,)
    assert (simulator.action_space.low == -1).all() and (simulator.action_space.high == 1).all()
    assert environment.horizon == horizon
    assert [environment.random_return, environment.expert_return] == returns
    simulator.close()


@each_environment
def test_the_demonstration_is_a_typical_expert_episode_to_the_horizon(environment) -> None:
    """On every processor: a lone drop must not be what every method is asked to imitate."""
    task = next(task for task in SUITE.tasks if task.environment is environment)
    card = json.loads((WEIGHTS / f"{environment.name}-expert.json").read_text(encoding="utf-8"))
    level = card["levels"]["sampled"]
    part = specification(SUITE, task, "expert")
    episodes = roll_out(part, demonstrator(environment.name, "expert"), 0, transitions=1)
    score = environment.normalized_score(float(episodes.returns()[0]))
    assert episodes.lengths.tolist() == [environment.horizon]
    assert abs(score - level["score_mean"]) <= level["score_std"] / 2
