"""What a declared grid makes of a plan: trials, the layer of a chosen value, and what a choice holds for."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers_engine import never, smoke_cell

from lfobench.cells.cell import Assigned, Cell
from lfobench.cells.plan import Plan, Request, make_plan
from lfobench.cells.tuning import Search, search_of, searches, tune_command
from lfobench.contract.suite import Budget
from lfobench.errors import UserError
from lfobench.record import Tuning

TUNED = str(Path(__file__).parents[1] / "tuned_suite.py")
MEDIUM, RANDOM = "pole-medium-expert", "pole-random-expert"


def search(task: str = MEDIUM, method: str = "bc", **request: Any) -> Search:
    found = search_of(smoke_cell(method, task, TUNED, **request))
    assert found is not None
    return found


def with_grid(grid: Mapping[str, tuple[Any, ...]]) -> Cell:
    cell = smoke_cell("bc", MEDIUM, TUNED)
    return replace(cell, task=replace(cell.task, grids={"bc": grid}))


def tuning(**chosen: Any) -> Tuning:
    grid = {field: [value] for field, value in chosen.items()}
    return Tuning(grid=grid, chosen=chosen, criterion="mean score", runs=1, steps=1)


def planned(methods: str, tasks: str | None = None, **request: Any) -> Plan:
    return make_plan(Request(methods, TUNED, tasks, protocol="smoke", **request), never)


# --- trials ----------------------------------------------------------------------------------------------------------


def test_every_combination_in_declared_order() -> None:
    found = search()
    assert [dict(cell.tuned) for cell in found.tried] == [
        {"learning_rate": rate, "hidden": widths} for rate in (0.01, 0.02) for widths in ([8, 8], [16, 16], [4])
    ]
    assert [(cell.config.learning_rate, cell.config.hidden) for cell in found.tried] == [  # type: ignore[attr-defined]
        (rate, widths) for rate in (0.01, 0.02) for widths in ((8, 8), (16, 16), (4,))
    ]
    assert found.grid == {"learning_rate": [0.01, 0.02], "hidden": [[8, 8], [16, 16], [4]]}


def test_the_grid_is_spelled_as_configurations_are() -> None:
    assert str(search(RANDOM).grid) == "{'learning_rate': [0.01, 1.0]}"


def test_a_trial_is_a_run_but_for_how_it_is_evaluated() -> None:
    cell = smoke_cell("bc", MEDIUM, TUNED)
    budget = Budget(steps=30, evaluation_every=10, evaluation_episodes=4, further_episodes=100)
    cell = replace(cell, protocol=cell.protocol.for_task(replace(cell.task, budgets={"smoke": budget})))
    found = search_of(cell)
    assert found is not None
    trials = found.trials(starts=7)
    assert len(trials) == 6
    for trial, tried in zip(trials, found.tried, strict=True):
        assert (trial.config, trial.recipe, trial.data) == (tried.config, cell.recipe, cell.data)
        assert trial.starts == "validation"
        assert trial.identity["protocol"] == {
            "name": "smoke",
            "steps": 30,
            "steps_assigned": False,
            "evaluation_every": 30,
            "evaluation_episodes": 7,
        }
        assert trial.tuning is None


def test_trials_are_told_apart_from_each_other_and_from_results() -> None:
    """A trial of as many starts and evaluations as the protocol's is still no result."""
    cell = smoke_cell("bc", MEDIUM, TUNED)
    cell = replace(cell, protocol=replace(cell.protocol, evaluation_every=40))
    found = search_of(cell)
    assert found is not None
    trials = found.trials(starts=2)
    identities = [each.identity for each in (cell, *found.tried, *trials)]
    assert all(one != other for index, one in enumerate(identities) for other in identities[:index])
    assert len({trial.label for trial in trials}) == 6, "progress tells them apart"


def test_a_cell_without_a_grid_has_no_search() -> None:
    assert search_of(smoke_cell("dilo", MEDIUM, TUNED)) is None
    assert search_of(smoke_cell("bco", MEDIUM, TUNED)) is None
    found = searches(planned("bc,bco"), Request("bc,bco", TUNED))
    assert [(each.cell.task.name, each.cell.method.name) for each in found] == [
        (RANDOM, "bc"),
        (RANDOM, "bco"),
        (MEDIUM, "bc"),
    ]


# --- the layer of a chosen value -------------------------------------------------------------------------------------


def test_chosen_values_lie_over_the_protocol_and_the_task() -> None:
    cell = smoke_cell("bc", MEDIUM, TUNED)
    assert cell.budget == {"batch_size": 24, "learning_rate": 0.5, "hidden": [32, 32]}
    tuned = search().chosen(tuning(learning_rate=0.02, hidden=[4]), ())
    assert tuned.config.model_dump(mode="json") == cell.config.model_dump(mode="json") | {
        "learning_rate": 0.02,
        "hidden": [4],
    }
    assert tuned.budget == {"batch_size": 24}
    assert tuned.assigned == {}, "no user set them"
    assert tuned.tuned == tuned.identity["tuned"] == {"learning_rate": 0.02, "hidden": [4]}
    assert tuned.tuning == tuning(learning_rate=0.02, hidden=[4])


def test_what_is_set_lies_over_chosen_values() -> None:
    assigned = ("bc.learning_rate=0.25", "bc.batch_size=16")
    found = search(assignments=assigned)
    tuned = found.chosen(tuning(learning_rate=0.02, hidden=[4]), ("learning_rate", "batch_size"))
    config = tuned.config.model_dump(mode="json")
    assert (config["learning_rate"], config["batch_size"], config["hidden"]) == (0.25, 16, [4])
    assert tuned.assigned == {"learning_rate": 0.25, "batch_size": 16}
    assert tuned.tuned == {"hidden": [4]}
    assert tuned.tuning is not None
    assert tuned.tuning.chosen == {"hidden": [4]}, "what this run has"
    assert found.chosen(tuning(learning_rate=0.02), ("learning_rate",)) == found.cell


def test_a_value_that_was_there_anyway_is_still_a_choice() -> None:
    cell = smoke_cell("bc", MEDIUM, TUNED)
    tuned = search().chosen(tuning(hidden=[32, 32]), ())
    assert tuned.config == cell.config
    assert tuned.identity == {
        **cell.identity,
        "overrides": {"batch_size": 24, "learning_rate": 0.5},
        "tuned": {"hidden": [32, 32]},
    }


def test_an_untuned_identity_is_what_it_was() -> None:
    assert {"tuned", "starts"}.isdisjoint(smoke_cell("bc", MEDIUM, TUNED).identity)


# --- what a choice holds for -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "request_",
    [
        {"assigned": Assigned(41)},
        {"preset": "paper"},
        {"precision": "bf16"},
        {"assignments": ("bc.batch_size=16",)},
        {"task": RANDOM},
    ],
    ids=str,
)
def test_another_request_needs_another_choice(request_: dict[str, Any]) -> None:
    assert search(**request_).hash != search().hash


@pytest.mark.parametrize(
    "grid",
    [
        {"learning_rate": (0.01,)},
        {"learning_rate": (0.02, 0.01), "hidden": ((8, 8), (16, 16), (4,))},
        {"learning_rate": (0.01, 0.02), "hidden": ((8, 8), (16, 16), (5,))},
    ],
    ids=str,
)
def test_another_grid_needs_another_choice(grid: dict[str, tuple[Any, ...]]) -> None:
    found = search_of(with_grid(grid))
    assert found is not None
    assert found.hash != search().hash


def test_what_evaluates_and_what_the_grid_replaces_do_not_matter() -> None:
    cell = smoke_cell("bc", MEDIUM, TUNED, assignments=("bc.learning_rate=0.25",))
    cell = replace(cell, protocol=replace(cell.protocol, evaluation_every=5, evaluation_episodes=9, further_episodes=3))
    found = search_of(cell)
    assert found is not None
    assert found.conditions == search().conditions
    assert found.hash == search().hash


# --- mistakes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ({"learning_rat": (1.0,)}, r"has the field 'learning_rat', which bc lacks.*'learning_rate'"),
        ({"learning_rate": ()}, r"no value for learning_rate"),
        ({"learning_rate": (0.1, "much")}, r"learning_rate = 'much'"),
        ({"learning_rate": (0.1, -1.0)}, r"learning_rate = -1"),
        ({"batch_size": (8, 16, 8.0)}, r"value of batch_size twice"),
        ({"batch_size": range(1, 10**6), "learning_rate": range(1, 10**6)}, r"999,998,000,001 combinations.*10,000"),
    ],
)
def test_a_suites_mistake_names_suite_task_and_field(grid: dict[str, tuple[Any, ...]], message: str) -> None:
    with pytest.raises(UserError, match=r"Suite 'tuned', task 'pole-medium-expert': the grid of bc.*" + message):
        search_of(with_grid(grid))


def test_no_grid_is_listed_before_it_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = with_grid({})
    values = tuple(range(1, 102))
    asked = {"bc": {"batch_size": values, "learning_rate": values}}
    with pytest.raises(UserError, match=r"--grid: the grid of bc has 10,201 combinations; at most 10,000"):
        search_of(cell, asked)
    monkeypatch.setattr(cell.method, "grids", asked["bc"])
    with pytest.raises(UserError, match=r"Method 'bc': its grid has 10,201 combinations; at most 10,000"):
        search_of(cell)


def test_a_method_without_a_grid_is_refused() -> None:
    with pytest.raises(UserError, match=r"no grid for dilo on any of 2 tasks.*'tuned'.*grid: bc, bco"):
        searches(planned("bc,dilo"), Request("bc,dilo", TUNED))
    with pytest.raises(UserError, match=r"no grid for bco on pole-medium-expert.*grid: bc\."):
        searches(planned("bco", MEDIUM), Request("bco", TUNED))


def test_a_field_of_the_grid_cannot_be_set() -> None:
    assigned = ("bc.batch_size=16", "bc.learning_rate=3")
    with pytest.raises(UserError, match=r"--set bc\.learning_rate names a field of the grid on pole-random-expert"):
        searches(planned("bc", assignments=assigned), Request("bc", TUNED, assignments=assigned))


def test_the_command_that_makes_a_choice_repeats_the_request() -> None:
    assigned = ("bc.batch_size=16", "bc.learning_rate=3", "dilo.tau=2", "bco.batch_size=8")
    request = Request(
        "bc,bco,dilo", TUNED, protocol="auto", assigned=Assigned(30), preset="paper", assignments=assigned
    )
    lacking = [search(MEDIUM), search(RANDOM)]
    words = shlex.split(tune_command(request, "quick", lacking, "some runs"))
    assert words == [
        *("lfobench", "tune", "--methods", "bc", "--suite", TUNED, "--tasks", f"{MEDIUM},{RANDOM}"),
        *("--protocol", "quick", "--steps", "30", "--preset", "paper", "--out", "some runs"),
        *("--set", "bc.batch_size=16"),
    ]
