"""Equal identities stand for equal numbers. These are today's; code that changes them must change the identity."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers_engine import finish, make_job, records_of, smoke_cell

from lfobench.contract.record import NUMBERS
from lfobench.registry import load_method

# Last row of training metrics of every stage: smoke protocol, the pole, seed 3.
TODAY = {
    ("bc", "released"): {"policy": {"policy_loss": 0.730029, "entropy": 0.676336}},
    ("bc", "paper"): {"policy": {"policy_loss": 0.7369}},
    ("bc-expert", "released"): {"policy": {"policy_loss": 0.865472, "entropy": 0.68957}},
    ("bc-expert", "paper"): {"policy": {"policy_loss": 0.860915}},
    ("bco", "released"): {
        "inverse dynamics": {"inverse_dynamics_loss": 0.290071},
        "policy": {"policy_loss": 0.00706962},
    },
    ("bco", "paper"): {"inverse dynamics": {"inverse_dynamics_loss": 0.290071}, "policy": {"policy_loss": 0.00706962}},
    ("dilo", "released"): {
        "policy": {
            "value_offline": 0.0700642,
            "value_expert": 0.0880719,
            "forward_loss": -0.0620483,
            "backward_loss": 0.0385474,
            "policy_loss": 0.321916,
            "policy_weight": 0.998091,
        }
    },
    ("dilo", "paper"): {
        "policy": {
            "value_offline": 0.0853843,
            "value_expert": 0.0979434,
            "forward_loss": -0.081051,
            "backward_loss": 0.051251,
            "policy_loss": 0.997262,
            "policy_weight": 0.933381,
        }
    },
    ("oril", "released"): {
        "discriminator": {"discriminator_loss": 1.39931, "gradient_penalty": 0.702761},
        "policy": {"critic_loss": 0.0106013, "target_value": -0.0821823},
    },
    ("oril", "paper"): {
        "discriminator": {"discriminator_loss": 1.39932, "gradient_penalty": 0.701994},
        "policy": {"critic_loss": 0.0106543, "target_value": -0.0825153},
    },
    ("smodice", "released"): {
        "discriminator": {"discriminator_loss": 1.39931, "gradient_penalty": 0.702761},
        "policy": {
            "value_loss": -0.0715205,
            "value_initial": 0.0253522,
            "policy_weight": 0.931524,
            "policy_loss": 0.687964,
            "entropy": 0.682199,
        },
    },
    ("smodice", "paper"): {
        "discriminator": {"discriminator_loss": 1.39932, "gradient_penalty": 0.701994},
        "policy": {
            "value_loss": -0.0718384,
            "value_initial": 0.0253522,
            "policy_weight": 0.931228,
            "policy_loss": 0.687743,
            "entropy": 0.682198,
        },
    },
}
BUILT_IN = ("bc", "bc-expert", "bco", "dilo", "oril", "smodice")


def test_every_built_in_method_and_preset_is_held() -> None:
    assert set(TODAY) == {(name, preset) for name in BUILT_IN for preset in load_method(name).presets}


@pytest.mark.parametrize(("name", "preset"), TODAY)
def test_numbers_change_with_their_version_only(name: str, preset: str, tmp_path: Path, shared_cache: Path) -> None:
    """If this fails on purpose: raise `Method.version` (one method) or `NUMBERS` (all), then write the new ones here.

    Forty steps from equal weights differ between processors by rounding only, far below the tolerance.
    """
    assert (load_method(name).version, NUMBERS) == (1, 2)
    job = make_job(smoke_cell(name, preset=preset), [3], tmp_path, shared_cache)
    finish(job)
    (record,) = records_of(job)
    found = {row.stage: row.values for row in record.metrics}
    assert found.keys() == TODAY[name, preset].keys()
    for stage, values in TODAY[name, preset].items():
        assert found[stage] == pytest.approx(values, rel=2e-3)


def test_evaluations_change_with_their_version_only(tmp_path: Path, shared_cache: Path) -> None:
    """Starts, transform and loop of the first evaluations: steps until the pole falls."""
    assert NUMBERS == 2
    job = make_job(smoke_cell("bc"), [3], tmp_path, shared_cache)
    finish(job)
    (record,) = records_of(job)
    assert [evaluation.lengths for evaluation in record.evaluations[:2]] == [[33, 14], [22, 19]]
