"""Equal identities stand for equal numbers. These are today's; code that changes them must change the identity."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers_engine import finish, make_job, records_of, smoke_cell

from lfobench.record import NUMBERS
from lfobench.registry import load_method

# Last row of training metrics of every stage: smoke protocol, the pole (whose actions are scaled), seed 3.
TODAY = {
    ("bc", "released"): {"policy": {"policy_loss": 0.808922, "entropy": 0.66982}},
    ("bc", "paper"): {"policy": {"policy_loss": 0.775547}},
    ("bc-expert", "released"): {"policy": {"policy_loss": 0.865483, "entropy": 0.68955}},
    ("bc-expert", "paper"): {"policy": {"policy_loss": 0.861004}},
    ("bco", "released"): {
        "inverse dynamics": {"inverse_dynamics_loss": 0.0295956},
        "policy": {"policy_loss": 0.0106046},
    },
    ("bco", "paper"): {"inverse dynamics": {"inverse_dynamics_loss": 0.0295956}, "policy": {"policy_loss": 0.0106046}},
    ("dilo", "released"): {
        "policy": {
            "value_offline": 0.0685922,
            "value_expert": 0.0878032,
            "forward_loss": -0.0620471,
            "backward_loss": 0.0384988,
            "policy_loss": 0.0430613,
            "policy_weight": 0.998055,
        }
    },
    ("dilo", "paper"): {
        "policy": {
            "value_offline": 0.0843064,
            "value_expert": 0.0978812,
            "forward_loss": -0.08115,
            "backward_loss": 0.0512271,
            "policy_loss": 0.865905,
            "policy_weight": 0.934346,
        }
    },
    ("oril", "released"): {
        "discriminator": {"discriminator_loss": 1.39411, "gradient_penalty": 0.706241},
        "policy": {"critic_loss": 0.00990165, "target_value": -0.0790146},
    },
    ("oril", "paper"): {
        "discriminator": {"discriminator_loss": 1.3941, "gradient_penalty": 0.705498},
        "policy": {"critic_loss": 0.00994103, "target_value": -0.0792707},
    },
    ("smodice", "released"): {
        "discriminator": {"discriminator_loss": 1.39411, "gradient_penalty": 0.706241},
        "policy": {
            "value_loss": -0.061219,
            "value_initial": 0.0207067,
            "policy_weight": 0.940759,
            "policy_loss": 0.81959,
            "entropy": 0.675646,
        },
    },
    ("smodice", "paper"): {
        "discriminator": {"discriminator_loss": 1.3941, "gradient_penalty": 0.705498},
        "policy": {
            "value_loss": -0.0614589,
            "value_initial": 0.0207046,
            "policy_weight": 0.940534,
            "policy_loss": 0.819411,
            "entropy": 0.675646,
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
    assert [evaluation.lengths for evaluation in record.evaluations[:2]] == [[22, 8], [27, 10]]
