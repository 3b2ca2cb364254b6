"""Configuration in layers, and the identity that decides whether a run is done."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from helpers_engine import POLE_TASK, TINY, Drifting, never, smoke_cell

from lfobench.cells.cell import PROTOCOLS, Assigned, Cell, Protocol, Run, configure
from lfobench.cells.plan import Request, make_plan
from lfobench.contract.method import MethodConfig, PresetName
from lfobench.contract.suite import Environment, Recipe
from lfobench.errors import UserError
from lfobench.registry import load_method, method_names
from lfobench.text import canonical_json


def test_layers_later_over_earlier() -> None:
    """Default, preset, the protocol's budget, --set."""
    dilo = load_method("dilo")
    defaults, quick = PROTOCOLS["paper"], PROTOCOLS["quick"]
    field = "policy_learning_rate"
    budget = dilo.budgets["quick"][field]
    by_layer = [
        configure(dilo, "released", defaults, {}),
        configure(dilo, "paper", defaults, {}),
        configure(dilo, "paper", quick, {}),
        configure(dilo, "paper", quick, {field: 0.5}),
    ]
    values = [getattr(layer.config, field) for layer in by_layer]
    assert values == [
        dilo.Config.model_fields[field].default,
        dilo.presets["paper"][field],
        budget,
        0.5,
    ]
    assert len(set(values)) == 4, "each layer is told apart"
    assert by_layer[0].budget == {}
    assert by_layer[2].budget[field] == budget, "what the protocol changed is declared"
    assert field not in by_layer[3].budget, "and no longer where the user decided"


@pytest.mark.parametrize("name", method_names())
@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=lambda protocol: protocol.name)
def test_every_built_in_configuration_is_valid(name: str, protocol: Protocol) -> None:
    method = load_method(name)
    for preset in method.presets:
        found = configure(method, preset, protocol, {})
        assert set(found.budget) <= set(type(found.config).model_fields)


@pytest.mark.parametrize(
    ("assigned", "message"),
    [
        ({"tua": 3}, r"Unknown field of dilo in --set 'tua'.*Did you mean 'tau'"),
        ({"tau": "much"}, r"--set dilo\.tau='much'.*number.*lfobench show dilo"),
        ({"tau": -1}, r"--set dilo\.tau=-1.*greater"),
        ({"tau": None}, r"--set dilo\.tau=None"),
        ({"tau": float("inf")}, r"--set dilo\.tau=inf"),
        ({"tau": float("nan")}, r"--set dilo\.tau=nan"),
        ({"batch_size": 1.5}, r"--set dilo\.batch_size=1\.5"),
        ({"batch_size": True}, r"--set dilo\.batch_size=True"),
        ({"batch_size": 0}, r"--set dilo\.batch_size=0"),
        ({"hidden": 64}, r"--set dilo\.hidden=64"),
        ({"hidden": [64, "x"]}, r"--set dilo\.hidden\.1='x'"),
        ({"hidden": [0]}, r"--set dilo\.hidden.*0"),
        ({"hidden": [-3]}, r"--set dilo\.hidden.*-3"),
        ({"policy": "gausian"}, r"--set dilo\.policy='gausian'.*gaussian"),
        ({"termination": True}, r"--set dilo\.termination=True"),
    ],
)
def test_wrong_values(assigned: Mapping[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message) as refused:
        configure(load_method("dilo"), "released", PROTOCOLS["smoke"], assigned)
    assert "\n" not in str(refused.value)


def test_an_unknown_preset() -> None:
    with pytest.raises(UserError, match=r"Unknown preset of dilo 'papper'.*Did you mean 'paper'"):
        configure(load_method("dilo"), "papper", PROTOCOLS["smoke"], {})


class Revised(Drifting):
    name = "drifting"
    version = 2


def base() -> Cell:
    """With something in every field."""
    return replace(smoke_cell("bc"), budget={"batch_size": 32}, assigned={"learning_rate": 0.25})


def environment(**changes: Any) -> dict[str, Any]:
    cell = base()
    return {"task": replace(cell.task, environment=replace(cell.task.environment, **changes))}


def recipe(**changes: Any) -> dict[str, Any]:
    cell = base()
    return {"task": replace(cell.task, recipe=replace(cell.task.recipe, **changes))}


def protocol(**changes: Any) -> dict[str, Any]:
    return {"protocol": replace(base().protocol, **changes)}


CHANGES_THAT_COUNT: dict[str, dict[str, Any]] = {
    "method": {"method": load_method("bc-expert")},
    "preset": {"preset": "paper"},
    "config": {"config": base().config.model_copy(update={"learning_rate": 0.125})},
    "budget": {"budget": {}},
    "assignment": {"assigned": {}},
    "task name": {"task": replace(base().task, name="pole-other-expert")},
    "environment name": environment(name="stick"),
    "environment id": environment(id="InvertedPendulum-v4"),
    "horizon": environment(horizon=61),
    "random return": environment(random_return=4.0),
    "expert return": environment(expert_return=59.0),
    "environment arguments": environment(arguments={"frame_skip": 3}),
    "offline level": recipe(offline="medium"),
    "offline transitions": recipe(offline_transitions=1_999),
    "expert level": recipe(expert="medium"),
    "expert trajectories": recipe(expert_trajectories=1),
    "demonstration rows": recipe(demonstration_rows=59),
    "source": {"source": "d4rl"},
    "offline part": {"data": {**base().data, "offline": "0" * 64}},
    "expert part": {"data": {**base().data, "expert": "0" * 64}},
    "protocol name": protocol(name="other"),
    "steps": protocol(steps=41),
    "assigned steps": protocol(assigned=Assigned(steps=41)),
    "evaluation interval": protocol(evaluation_every=11),
    "evaluation episodes": protocol(evaluation_episodes=3),
    "simulator": {"simulator": {**base().simulator, "mujoco": "0.0"}},
    "precision": {"precision": "bf16"},
}

CHANGES_THAT_DO_NOT: dict[str, dict[str, Any]] = {
    "suite's name or path": {"suite": "elsewhere.py"},
    "group of rows": {"task": replace(base().task, group="other")},
    "paper steps that the protocol overrides": {"task": replace(base().task, paper_steps=7)},
    "protocol's summary": protocol(summary="other words"),
    "protocol's default seeds": protocol(seeds="0-99"),
    "a cap above the recipe": protocol(expert_trajectories=None) | recipe(expert_trajectories=2),
}


@pytest.mark.parametrize("what", CHANGES_THAT_COUNT)
def test_identity_changes_with_every_field_that_decides_numbers(what: str) -> None:
    cell = base()
    changed = replace(cell, **CHANGES_THAT_COUNT[what])
    assert Run(changed, 0).identity_hash != Run(cell, 0).identity_hash


@pytest.mark.parametrize("what", CHANGES_THAT_DO_NOT)
def test_identity_stays_with_every_other_field(what: str) -> None:
    cell = base()
    changed = replace(cell, **CHANGES_THAT_DO_NOT[what])
    assert Run(changed, 0).identity == Run(cell, 0).identity
    assert Run(changed, 0).identity_hash == Run(cell, 0).identity_hash


def test_identity_has_the_seed_and_the_methods_version() -> None:
    one = replace(base(), method=Drifting, config=Drifting.Config())
    assert Run(one, 0).identity_hash != Run(one, 1).identity_hash
    assert Run(one, 0).identity_hash != Run(replace(one, method=Revised), 0).identity_hash


def test_every_identity_is_plain_json() -> None:
    for name in method_names():
        identity = Run(smoke_cell(name, assignments=(f"{name}.hidden=[8,8]",)), 3).identity
        assert canonical_json(identity)


@pytest.mark.parametrize("name", method_names())
def test_order_and_spelling_of_assignments_do_not_matter(name: str) -> None:
    one = smoke_cell(name, assignments=(f"{name}.hidden=[8, 8]", f"{name}.batch_size=16"))
    two = smoke_cell(name, assignments=(f"{name}.batch_size=16", f"{name}.hidden=[8,8]"))
    assert one.identity == two.identity
    assert Run(one, 0).identity_hash == Run(two, 0).identity_hash
    assert cast(Any, one.config).hidden == (8, 8)


@pytest.mark.parametrize("spelling", ["16.0", '"16"'])
def test_spellings_of_one_value_are_one_run(spelling: str) -> None:
    """Two commands that train the same thing find each other's records."""
    plain = smoke_cell("bc", assignments=("bc.batch_size=16",))
    try:
        other = smoke_cell("bc", assignments=(f"bc.batch_size={spelling}",))
    except UserError:
        return
    assert Run(other, 0).identity_hash == Run(plain, 0).identity_hash


def test_identity_is_the_same_in_another_process() -> None:
    """Written down on disk, it must not depend on hash seeds or import order."""
    script = (
        "from helpers_engine import smoke_cell; from lfobench.cells.cell import Run\n"
        "print(Run(smoke_cell('dilo', assignments=('dilo.tau=3',)), 5).identity_hash)"
    )
    answer = subprocess.run(
        [sys.executable, "-c", script],
        env={"PYTHONPATH": str(Path(TINY).parent), "PYTHONHASHSEED": "1", "PATH": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stdout.strip() == Run(smoke_cell("dilo", assignments=("dilo.tau=3",)), 5).identity_hash


def test_an_unset_field_is_not_an_assignment() -> None:
    presets = cast(Mapping[PresetName, Mapping[str, Any]], load_method("dilo").presets)
    found = configure(load_method("dilo"), "released", PROTOCOLS["paper"], {})
    assert isinstance(found.config, MethodConfig)
    assert found.budget == {} and found.assigned == {}
    assert presets["released"] == {}


@pytest.mark.parametrize("method", ["dilo", "bco"])
def test_a_field_that_came_later_enters_the_identity_only_where_it_differs(method: str) -> None:
    cell = smoke_cell(method)
    changed = replace(cell, config=cell.config.model_copy(update={"standardize": True}))
    assert "standardize" not in cell.identity["config"]
    assert changed.identity["config"] == {**cell.identity["config"], "standardize": True}
    assert type(cell.config).model_validate(cell.identity["config"]) == cell.config


@pytest.mark.parametrize(("request_steps", "expected"), [(None, 12_000), (24_000, 24_000)])
def test_a_schedule_over_the_whole_run_follows_the_steps(request_steps: int | None, expected: int) -> None:
    (cell,) = make_plan(
        Request("dilo", TINY, POLE_TASK, protocol="quick", assigned=Assigned(request_steps)), never
    ).cells
    assert cell.config.model_dump()["policy_cosine_steps"] == expected


def test_quick_standardises_observations_for_every_method() -> None:
    for method in map(load_method, ("dilo", "smodice", "oril", "bco", "bc", "bc-expert")):
        quick, paper = (
            method.needs(configure(method, "released", PROTOCOLS[protocol], {}).config).standardize
            for protocol in ("quick", "paper")
        )
        assert quick and paper == (method.name not in ("dilo", "bco"))


def test_assigned_evaluations_take_the_place_of_a_tasks_own_budget_and_of_nothing_else() -> None:
    assigned = Assigned(evaluation_episodes=7)
    for suite, tasks in ((TINY, POLE_TASK), ("airhockey", "puck-striking-20-expert")):
        plain, changed = (
            make_plan(Request("bc", suite, tasks, protocol="quick", assigned=each), never).cells[0].identity
            for each in (Assigned(), assigned)
        )
        assert changed == {**plain, "protocol": {**plain["protocol"], "evaluation_episodes": 7}}


def test_labels_carry_what_tables_need() -> None:
    labels = smoke_cell("bc").labels
    assert (labels.group, labels.row, labels.sees_expert_actions) == ("random+expert", "pole", True)
    assert not smoke_cell("dilo").labels.sees_expert_actions


def test_a_recipe_is_capped_never_raised() -> None:
    task = smoke_cell("bc").task
    small = replace(task, recipe=Recipe("random", 10, "expert", 1, 60))
    for each in PROTOCOLS.values():
        assert each.recipe_for(small) == small.recipe
    capped = PROTOCOLS["smoke"].recipe_for(task)
    assert (capped.offline_transitions, capped.expert_trajectories) == (2_000, 2)
    assert isinstance(task.environment, Environment)


@pytest.mark.parametrize(
    ("field", "value"),
    [("steps", 0), ("evaluation_every", -1), ("evaluation_episodes", 10**6), ("final_episodes", True), ("steps", 2.5)],
)
def test_what_is_no_number_of_steps_or_episodes(field: str, value: Any) -> None:
    with pytest.raises(UserError, match=f"--{field.replace('_', '-')} .*whole number"):
        Assigned(**{field: value})
