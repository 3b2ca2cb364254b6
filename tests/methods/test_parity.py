"""The shipped methods against twenty kept updates of float64 references: no agreement is lost unseen."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import parity
import pytest
import torch
from parity import CASES, FILE, Case, make, read, replay, unpack

from lfobench.contract.method import Method

cases = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)

TOLERANCE, FURTHEST = 3e-5, 1e-3
"""Deviations relative to the mean distance that the parameters of a network moved: the median one, and the root mean
square, which a single gradient near 0 may raise, since Adam turns its rounding into a step. float32 leaves up to 7e-6
and 1e-4; every change below leaves more than twice the tolerance.
"""


def deviations(case: Case, method: Method) -> tuple[float, float]:
    """The median and the root mean square deviation of the network with the largest."""
    initial, final = read(case, "initial"), read(case, "final")
    found = replay(case, method, initial, unpack(case, read(case, "inputs")))
    assert set(found) == set(final)
    start = {name: initial[parity.TARGETS.get(case.method, {}).get(name, name)] for name in final}
    medians, squares = [], []
    for name, wanted in final.items():
        moved = np.abs(wanted - start[name][:, : wanted.shape[1]]).mean(1, keepdims=True)
        relative = np.abs(found[name] - wanted) / np.maximum(moved, 1e-12)
        medians += np.median(relative, axis=1).tolist()
        squares += np.sqrt((relative**2).mean(1)).tolist()
    return max(medians), max(squares)


@cases
def test_twenty_updates_end_where_the_reference_ends(case: Case) -> None:
    median, square = deviations(case, case.build())
    assert median < TOLERANCE
    assert square < FURTHEST


FIELDS: list[tuple[str, dict[str, Any]]] = [
    ("dilo:released", {"conservatism": 0.801}),
    ("dilo:released", {"mixture": 0.501}),
    ("dilo:released", {"backward_weight": 0.501}),
    ("dilo:released", {"discount": 0.985}),
    ("dilo:released", {"tau": 0.51}),
    ("dilo:released", {"target_rate": 0.0501}),
    ("dilo:released", {"policy_cosine_steps": 41}),
    ("dilo:paper", {"weight_limit": 1.31}),
    ("dilo:paper", {"tau": 3.01}),
    ("smodice:released", {"gradient_penalty": 10.5}),
    ("smodice:released", {"discount": 0.985}),
    ("smodice:released", {"value_weight_decay": 2e-4}),
    ("smodice:released", {"entropy_constraint": False}),
    ("smodice:released", {"freeze_first_layer": False}),
    ("smodice:paper", {"divergence": "kl"}),
    ("oril:released", {"smoothing_noise": 0.21}),
    ("oril:released", {"smoothing_limit": 0.3}),
    ("oril:released", {"value_weight": 2.51}),
    ("oril:released", {"target_rate": 0.0501}),
    ("seabo:released", {"expectile": 0.701}),
    ("seabo:released", {"inverse_temperature": 3.01}),
    ("seabo:released", {"weight_limit": 2.9}),
    ("seabo:released", {"discount": 0.985}),
    ("seabo:released", {"target_rate": 0.0501}),
    ("bco:released", {"inverse_dynamics_learning_rate": 3.01e-3}),
    ("bc:released", {"loss": "likelihood"}),
    ("bc:paper", {"learning_rate": 3.01e-3}),
]


@pytest.mark.parametrize(("name", "changed"), FIELDS, ids=lambda value: str(value))
def test_a_small_change_of_a_number_is_seen(name: str, changed: dict[str, Any]) -> None:
    case = next(case for case in CASES if case.name == name)
    assert deviations(case, case.build(**changed))[0] > 2 * TOLERANCE


def mean_of_twins(dilo: Any) -> None:
    dilo.target_values = lambda pairs: dilo.target(pairs).detach().squeeze(-1).mean(1, keepdim=True)


def no_projection(dilo: Any) -> None:
    dilo.orthogonal_sum = lambda linear, forward, backward: linear + forward + backward


def policy_before_value(dilo: Any) -> None:
    def update(stage: str, offline: Any, expert: Any, randomness: Any) -> dict[str, Any]:
        dilo.update_policy(offline)
        dilo.update_value(offline, expert)
        dilo.target.follow(dilo.value, dilo.config.target_rate)
        return {}

    dilo.update = update


def target_before_policy(dilo: Any) -> None:
    original = dilo.update_policy

    def swapped(offline: Any) -> dict[str, Any]:
        dilo.target.follow(dilo.value, dilo.config.target_rate)
        return dict(original(offline))

    dilo.update_policy = swapped


def normalised_weights(smodice: Any) -> None:
    smodice.policy_weights = lambda residual: torch.softmax(residual, -1) * residual.shape[-1]


def weights_after_the_value_step(smodice: Any) -> None:
    original = smodice.policy_weights
    batch: dict[str, Any] = {}
    residual = smodice.residual

    def remember(offline: Any) -> Any:
        batch["offline"] = offline
        return residual(offline)

    smodice.residual = remember
    smodice.policy_weights = lambda _: original(residual(batch["offline"]).detach())


def second_critic_alone(oril: Any) -> None:
    original = oril.critic_target_value

    def changed(offline: Any, noise: Any) -> Any:
        twins = oril.critic_target
        oril.critic_target = lambda inputs: twins(inputs)[:, 1:]
        value = original(offline, noise)
        oril.critic_target = twins
        return value

    oril.critic_target_value = changed


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("dilo:released", mean_of_twins),
        ("dilo:released", no_projection),
        ("dilo:released", policy_before_value),
        ("dilo:released", target_before_policy),
        ("smodice:released", normalised_weights),
        ("smodice:released", weights_after_the_value_step),
        ("oril:released", second_critic_alone),
    ],
)
def test_a_change_of_the_algorithm_is_seen(name: str, change: Callable[[Any], None]) -> None:
    case = next(case for case in CASES if case.name == name)
    method = case.build()
    change(method)
    assert deviations(case, method)[0] > 2 * TOLERANCE


@pytest.mark.slow
@cases
def test_the_kept_numbers_are_those_of_the_references(case: Case) -> None:
    fresh = make(case)
    with np.load(FILE, allow_pickle=False) as kept:
        assert {name for name in kept.files if name.startswith(f"{case.name}/")} == set(fresh)
        for name, array in fresh.items():
            np.testing.assert_allclose(kept[name], array, rtol=0.0, atol=1e-7, err_msg=name)
