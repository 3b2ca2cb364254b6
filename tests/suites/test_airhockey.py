"""The suite's numbers, compared with the published table and the demonstrators."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lfobench.cells.plan import Request, make_plan
from lfobench.contract.suite import Recipe, ScriptedDemonstrator, Suite, Task
from lfobench.registry import load_method
from suites.airhockey import APPENDIX, SHARE, SUITE
from suites.robot import constants, register_environments
from suites.robot.demonstrators import SUCCESS_SHARES

PUBLISHED = Path(__file__).resolve().parents[2] / "results" / "published" / "dilo-2024" / "airhockey.csv"

# group: expert trajectories, transitions drawn of them
EXPERTS = {
    "few-trajectories": (15, None),
    "fixed-start": (15, None),
    "few-uniform": (15, 300),
    "20-expert": (20, None),
    "10-expert": (10, None),
    "400-expert-touch": (400, None),
    "400-expert-hit": (400, None),
    "400-expert": (400, None),
    "900-expert-touch": (900, None),
    "900-expert-hit": (900, None),
}
# environment: steps of a suboptimal recording in the paper, observation
ENVIRONMENTS = {
    "safe-manipulation": (100, 2),
    "safe-manipulation-cross-embodiment": (100, 2),
    "puck-striking": (75, 4),
    "dynamic-hitting": (200, 14),
}

each = pytest.mark.parametrize("task", SUITE.tasks, ids=lambda task: task.name)
both = pytest.mark.parametrize(
    ("suite", "task"),
    [pytest.param(suite, task, id=f"{suite.name}: {task.name}") for suite in (SUITE, APPENDIX) for task in suite.tasks],
)


def published() -> Iterator[dict[str, str]]:
    with PUBLISHED.open(encoding="utf-8") as file:
        yield from csv.DictReader(file)


def recipe_of(task: Task) -> Recipe:
    return task.recipe


def test_a_footnote_claims_no_rule_for_ends_that_recorded_data_does_not_follow() -> None:
    cells = make_plan(Request("dilo,smodice", "airhockey", "puck-*", protocol="quick"), lambda: False).cells
    assert all("termination" not in cell.labels.stated for cell in cells)
    assert {field for cell in cells for field in cell.labels.stated} >= {"tau", "conservatism", "divergence"}


def test_ten_tasks_in_the_order_of_the_published_table() -> None:
    names = list(dict.fromkeys(f"{row['task']}-{row['dataset']}" for row in published()))
    assert [task.name for task in SUITE.tasks] == names
    assert [f"{task.environment.name}-{task.group}" for task in SUITE.tasks] == names
    assert len(names) == 10


@each
def test_a_task_has_many_test_starts_and_the_published_number_of_them_as_a_subset(task: Task) -> None:
    trials = {int(row["trials"]) for row in published() if f"{row['task']}-{row['dataset']}" == task.name}
    for protocol in ("paper", "quick", "demo"):
        assert task.budgets[protocol].evaluation_episodes >= 50
        assert task.budgets[protocol].further_episodes == 50
    assert {task.published_starts} == trials
    assert task.budgets["smoke"].further_episodes == 0
    assert task.budgets["paper"].methods is None and task.budgets["quick"].methods == "demo"


@both
def test_the_expert_data_is_counted_as_in_the_paper(suite: Suite, task: Task) -> None:
    recipe = recipe_of(task)
    assert (recipe.demonstrations, recipe.expert_transitions) == EXPERTS[task.group]
    assert recipe.expert_actions == ("cross-embodiment" not in task.name)
    assert recipe.expert.endswith("-fixed") == (task.group == "fixed-start")
    judged = "-touch" if task.group.endswith("touch") else ""
    assert recipe.offline == f"{'half-successful' if suite is SUITE else 'suboptimal'}{judged}"
    assert recipe.success_share == (0.5 if suite is SUITE else None)
    assert recipe.expert.endswith("-touch") == bool(judged)
    assert recipe.equal_transitions == (suite is SUITE)
    if suite is APPENDIX:
        assert recipe.offline_trajectories == 50


def test_every_share_has_its_own_task_that_differs_in_nothing_else() -> None:
    shares = [task.recipe.success_share for task in SHARE.tasks]
    assert shares == [*SUCCESS_SHARES.values()] * 3
    half = [task for task in SHARE.tasks if task.recipe.success_share == 0.5]
    for task in half:
        original = next(each for each in SUITE.tasks if task.name.startswith(each.name))
        assert replace(task.recipe, offline_trajectories=1) == replace(original.recipe, offline_trajectories=1)
        assert task.environment == original.environment


@pytest.mark.slow
@pytest.mark.parametrize("task", [*SUITE.tasks, *SHARE.tasks], ids=lambda task: task.name)
def test_there_are_enough_offline_recordings_for_an_equal_share(task: Task) -> None:
    recipe = recipe_of(task)
    steps = []
    for level in (recipe.expert, recipe.offline):
        maker = SUITE.demonstrator(task.environment.name, level)
        assert isinstance(maker, ScriptedDemonstrator)
        steps.append(maker.record(40, np.random.default_rng(0)).lengths.mean())
    expert, offline = steps
    assert recipe.offline_trajectories is not None
    assert recipe.offline_trajectories * offline > 1.2 * recipe.demonstrations * expert


@pytest.mark.parametrize("suite", [SUITE, APPENDIX, SHARE], ids=lambda suite: suite.name)
def test_every_name_that_a_suite_uses_is_known(suite: Suite) -> None:
    assert suite.scene is not None
    for task in suite.tasks:
        name, recipe = task.environment.name, recipe_of(task)
        scene = suite.scene(name)
        assert (scene.puck_radius is None) == name.startswith("safe")
        for level in (recipe.offline, recipe.expert):
            assert suite.demonstrator(name, level).fingerprint


@each
def test_an_environment_is_built_and_scores_successes_in_per_cent(task: Task) -> None:
    register_environments()
    environment = task.environment
    assert (environment.normalized_score(0.0), environment.normalized_score(1.0)) == (0.0, 100.0)
    built, many = environment.make(), environment.make_many(3)
    assert many is not None
    size = ENVIRONMENTS[environment.name][1]
    assert built.observation_space.shape == (size,)
    assert many.reset(seed=1)[0].shape == (3, size)
    built.close()
    many.close()


def test_one_table_is_scored_in_two_ways() -> None:
    touch, hit = (task.environment for task in SUITE.tasks[-2:])
    assert (touch.arguments, hit.arguments) == ({"score": "touch"}, {"score": "hit"})
    assert (touch.name, touch.id, touch.horizon) == (hit.name, hit.id, int(constants.HITTING_HORIZON))


@each
def test_settings_and_grids_name_fields_of_the_methods_and_values_that_they_take(task: Task) -> None:
    for method, settings in task.settings.items():
        load_method(method).Config(**settings)
    for method, grid in task.grids.items():
        for field, values in grid.items():
            for value in values:
                load_method(method).Config(**{field: value})


def test_the_grids_are_those_of_the_paper() -> None:
    (grids,) = {repr(task.grids) for task in (*SUITE.tasks, *APPENDIX.tasks)}
    assert grids == repr(
        {
            "bco": {"inverse_dynamics_epochs": (1, 5, 10)},
            "smodice": {"discriminator_passes": (1, 5), "gradient_penalty": (1.0, 5.0, 10.0, 20.0)},
            "dilo": {"conservatism": (0.5, 0.6, 0.7, 0.8)},
        }
    )
