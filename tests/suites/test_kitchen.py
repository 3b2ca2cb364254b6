"""The suite by its numbers, and where its data come from."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from lfobench.cells.plan import Request, make_plan
from lfobench.cells.sources import nowhere, read_from
from lfobench.contract.suite import Recipe, Suite, Task
from suites.kitchen import PAPER, SUITE, WITHOUT_GOAL

PUBLISHED = Path(__file__).resolve().parents[2] / "results" / "published" / "dilo-2024" / "table1.csv"
SUITES = {"kitchen": 1, "kitchen-paper": 30, "kitchen-without-goal": 1}

every = pytest.mark.parametrize(
    ("suite", "task"),
    [
        pytest.param(suite, task, id=f"{suite.name}: {task.name}")
        for suite in (SUITE, PAPER, WITHOUT_GOAL)
        for task in suite.tasks
    ],
)


def recipe_of(task: Task) -> Recipe:
    return task.recipe


def test_the_tasks_are_the_rows_of_the_published_table() -> None:
    with PUBLISHED.open(encoding="utf-8") as file:
        rows = [tuple(row.values())[:2] for row in csv.DictReader(file)]
    names = list(dict.fromkeys(f"{name}-{data}" for name, data in rows if name == "kitchen"))
    assert [task.name for task in SUITE.tasks] == names == ["kitchen-partial-expert", "kitchen-mixed-expert"]


@every
def test_a_task_is_the_published_recipe(suite: Suite, task: Task) -> None:
    offline = task.name.split("-")[1]
    recipe, environment = recipe_of(task), task.environment
    assert (recipe.offline, recipe.offline_transitions, recipe.expert) == (offline, 136_950, "expert")
    assert (recipe.expert_trajectories, recipe.demonstration_rows) == (SUITES[suite.name], 183)
    assert (task.group, task.paper_steps) == (f"{offline}+expert", 1_000_000)
    assert (environment.name, environment.horizon) == ("kitchen", 280)
    assert (environment.normalized_score(0.0), environment.normalized_score(4.0)) == (0.0, 100.0)
    assert environment.arguments["variant"] == offline


@every
def test_the_environment_is_that_of_the_files(suite: Suite, task: Task) -> None:
    without = suite is WITHOUT_GOAL
    (read,) = read_from([task], "d4rl", None, nowhere)
    assert read.environment == task.environment and read.recipe == task.recipe
    assert task.environment.arguments["layout"] == ("d4rl-without-goal" if without else "d4rl-with-goal")
    files = task.files["d4rl"]
    assert files.offline is not None and files.expert is not None
    assert files.offline.name == f"kitchen-{task.name.split('-')[1]}-v0"
    assert files.expert.name == "kitchen-complete-v0"
    assert files.offline.columns == files.expert.columns == (30 if without else None)


def test_minari_has_its_own_layout_and_is_read_whole() -> None:
    for task in (*SUITE.tasks, *PAPER.tasks):
        (read,) = read_from([task], "minari", None, nowhere)
        variant = task.name.split("-")[1]
        assert read.environment.arguments == {"variant": variant, "layout": "minari"}
        assert recipe_of(read).offline_transitions == 156_560
        assert recipe_of(read).expert_trajectories == recipe_of(task).expert_trajectories
        assert read.read_from is not None and read.read_from.offline is not None and read.read_from.expert is not None
        assert read.read_from.offline.addresses == (f"minari:D4RL/kitchen/{variant}-v2",)
        assert read.read_from.expert.addresses == ("minari:D4RL/kitchen/complete-v2",)
    assert all("minari" not in task.files for task in WITHOUT_GOAL.tasks)


@every
def test_all_that_a_recipe_names_can_be_generated(suite: Suite, task: Task) -> None:
    assert suite.demonstrator is not None
    recipe = recipe_of(task)
    assert suite.demonstrator(task.environment.name, recipe.offline).fingerprint
    assert suite.demonstrator(task.environment.name, recipe.expert).fingerprint


@pytest.mark.parametrize("preset", ["released", "paper"])
@pytest.mark.parametrize("suite", ["kitchen", "kitchen-paper", "kitchen-without-goal", "table1"])
def test_smodice_and_oril_are_as_their_authors_run_them_here(suite: str, preset: str) -> None:
    """chi^2, no absorbing state, and, where the mix is released, no expert trajectory in it."""
    request = Request("smodice,oril,dilo,bco", suite, "kitchen-*", preset=preset, protocol="quick")
    for cell in make_plan(request, lambda: False).cells:
        name, config = cell.method.name, cell.identity["config"]
        own = name in ("smodice", "oril")
        assert config.get("absorbing", False) is False
        assert config.get("divergence", "chi2") == "chi2"
        assert cell.needs.expert_joins == (not own or suite == "kitchen-paper")
        assert cell.identity.get("expert_joins", True) == cell.needs.expert_joins
        assert cell.recipe.expert_trajectories == (30 if suite == "kitchen-paper" else 1)
    (hopper,) = make_plan(Request("smodice", "locomotion", "hopper-random-expert"), lambda: False).cells
    assert (hopper.identity["config"]["divergence"], hopper.needs.expert_joins) == ("kl", True)
    assert "expert_joins" not in hopper.identity
