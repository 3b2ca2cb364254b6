"""Equal identities stand for equal numbers. These are today's; code that changes them must change the identity."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers_engine import finish, make_job, records_of, smoke_cell

from lfobench.contract.record import NUMBERS
from lfobench.registry import load_method, method_names

# Last row of training metrics of the smoke protocol on the pole, seed 3.
TODAY = {
    "bc": {"policy_loss": 0.730029, "entropy": 0.676336},
    "bc-expert": {"policy_loss": 0.865472, "entropy": 0.68957},
    "bco": {"policy_loss": 0.00706962},
    "dilo": {
        "value_offline": 0.0700642,
        "value_expert": 0.0880719,
        "forward_loss": -0.0620483,
        "backward_loss": 0.0385474,
        "policy_loss": 0.321916,
        "policy_weight": 0.998091,
    },
    "oril": {"critic_loss": 0.0106013, "target_value": -0.0821823},
    "smodice": {
        "value_loss": -0.0715205,
        "value_initial": 0.0253522,
        "policy_weight": 0.931524,
        "policy_loss": 0.687964,
        "entropy": 0.682199,
    },
}


@pytest.mark.parametrize("name", method_names())
def test_numbers_change_with_their_version_only(name: str, tmp_path: Path, shared_cache: Path) -> None:
    """If this fails on purpose: raise `Method.version` (one method) or `NUMBERS` (all), then write the new ones here.

    Forty steps from equal weights differ between processors by rounding only, far below the tolerance.
    """
    assert (load_method(name).version, NUMBERS) == (1, 1)
    job = make_job(smoke_cell(name), [3], tmp_path, shared_cache)
    finish(job)
    (record,) = records_of(job)
    assert record.metrics[-1].values == pytest.approx(TODAY[name], rel=2e-3)
