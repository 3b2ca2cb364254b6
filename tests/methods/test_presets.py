from __future__ import annotations

from typing import Any, get_args

import pytest
import torch
from pydantic import ValidationError

from lfobench import registry
from lfobench.cells.cell import PROTOCOLS
from lfobench.contract.method import Field, Method, Shapes, Sizes, budget_fields
from lfobench.data.firewall import check_declaration

ALL = registry.method_names()
methods = pytest.mark.parametrize("method", [registry.load_method(name) for name in ALL], ids=ALL)

# Numbers of the papers and of the released code (docs/methods.md).
STATED: list[tuple[str, str, dict[str, Any]]] = [
    (
        "dilo",
        "released",
        {
            "batch_size": 1024,
            "hidden": (256, 256),
            "discount": 0.99,
            "conservatism": 0.8,
            "mixture": 0.5,
            "backward_weight": 0.5,
            "tau": 0.06,
            "weight_limit": 100.0,
            "policy": "deterministic",
            "value_learning_rate": 3e-4,
            "policy_learning_rate": 1e-4,
            "policy_cosine_steps": 1_000_000,
            "target_rate": 0.005,
            "termination": "teleport",
        },
    ),
    (
        "dilo",
        "paper",
        {
            "batch_size": 1024,
            "conservatism": None,
            "mixture": 0.5,
            "backward_weight": 0.5,
            "tau": 3.0,
            "policy": "gaussian",
            "policy_learning_rate": 3e-4,
            "policy_cosine_steps": None,
        },
    ),
    (
        "smodice",
        "released",
        {
            "batch_size": 512,
            "hidden": (256, 256),
            "discount": 0.99,
            "divergence": "kl",
            "learning_rate": 3e-4,
            "value_weight_decay": 1e-4,
            "discriminator_passes": 1000,
            "discriminator_batch": 256,
            "discriminator_learning_rate": 3e-4,
            "gradient_penalty": 10.0,
            "freeze_first_layer": True,
            "entropy_constraint": True,
            "absorbing": True,
        },
    ),
    ("smodice", "paper", {"batch_size": 1024, "freeze_first_layer": False}),
    (
        "oril",
        "released",
        {
            "batch_size": 512,
            "hidden": (256, 256),
            "discount": 0.99,
            "learning_rate": 3e-4,
            "target_rate": 0.005,
            "smoothing_noise": 0.2,
            "smoothing_limit": 0.5,
            "value_weight": 2.5,
            "policy_delay": 2,
            "discriminator_passes": 1000,
            "freeze_first_layer": True,
            "absorbing": True,
        },
    ),
    ("oril", "paper", {"batch_size": 1024, "freeze_first_layer": False}),
    (
        "bco",
        "released",
        {
            "batch_size": 1024,
            "hidden": (256, 256),
            "inverse_dynamics_epochs": 5,
            "inverse_dynamics_learning_rate": 3e-4,
            "policy_learning_rate": 1e-4,
        },
    ),
    ("bc", "released", {"batch_size": 512, "loss": "entropy-constrained", "learning_rate": 3e-4}),
    ("bc", "paper", {"batch_size": 1024, "loss": "likelihood"}),
    ("bc-expert", "released", {"batch_size": 512, "loss": "entropy-constrained", "learning_rate": 3e-4}),
    ("bc-expert", "paper", {"batch_size": 1024, "loss": "likelihood"}),
]


@pytest.mark.parametrize(("name", "preset", "stated"), STATED, ids=[f"{name}-{preset}" for name, preset, _ in STATED])
def test_presets_hold_the_stated_numbers(name: str, preset: str, stated: dict[str, Any]) -> None:
    method = registry.load_method(name)
    config = method.Config(**method.presets[preset]).model_dump()
    assert {field: config[field] for field in stated} == stated


@methods
def test_both_presets_exist_and_released_is_the_default(method: type[Method]) -> None:
    assert set(method.presets) == {"released", "paper"}
    assert dict(method.presets["released"]) == {}


def budgets(method: type[Method]) -> list[dict[str, object]]:
    return [budget_fields(fields, 7) for fields in method.budgets.values()]


@methods
def test_overrides_of_presets_and_budgets_name_fields_and_validate(method: type[Method]) -> None:
    assert set(method.budgets) <= set(PROTOCOLS)
    for preset in method.presets.values():
        for budget in ({}, *budgets(method)):
            overrides = {**preset, **budget}
            assert set(overrides) <= set(method.Config.model_fields)
            config = method.Config(**overrides).model_dump()
            assert {field: config[field] for field in overrides} == overrides


@methods
def test_overrides_change_something(method: type[Method]) -> None:
    defaults = method.Config().model_dump()
    for overrides in (*method.presets.values(), *budgets(method)):
        assert all(defaults[field] != value for field, value in overrides.items())


@methods
def test_every_field_is_described(method: type[Method]) -> None:
    for name, field in method.Config.model_fields.items():
        assert field.description, name
        assert not field.is_required(), name


@methods
def test_unknown_fields_and_changes_are_refused(method: type[Method]) -> None:
    with pytest.raises(ValidationError, match="no_such_field"):
        method.Config(no_such_field=1)
    config = method.Config()
    with pytest.raises(ValidationError, match="frozen"):
        config.batch_size = 7  # type: ignore[attr-defined]


@methods
@pytest.mark.parametrize("value", [-1, "many", float("nan")])
def test_nonsense_is_refused(method: type[Method], value: object) -> None:
    numbers = {"batch_size", "learning_rate", "value_learning_rate", "policy_learning_rate", "discount"}
    for field in numbers & set(method.Config.model_fields):
        with pytest.raises(ValidationError, match=field):
            method.Config(**{field: value})


@methods
def test_declarations_pass_the_firewall_under_every_preset(method: type[Method]) -> None:
    fields = set(get_args(Field))
    for preset in method.presets.values():
        needs = method.needs(method.Config(**preset))
        check_declaration(method, needs)
        assert set(needs.offline) | set(needs.expert) <= fields
        assert ("action" in needs.expert) <= method.access_to_expert_actions


@methods
def test_only_the_last_stage_leaves_its_length_to_the_protocol(method: type[Method]) -> None:
    for overrides in (*method.presets.values(), *budgets(method)):
        built = method(method.Config(**overrides), Shapes(4, 2), [0], torch.device("cpu"))
        *earlier, last = built.stages(Sizes(offline=3000, expert=999))
        assert last.steps is None
        assert all(stage.steps is not None and stage.steps > 0 for stage in earlier)


@methods
def test_the_name_is_the_registered_one(method: type[Method]) -> None:
    assert registry.load_method(method.name) is method
