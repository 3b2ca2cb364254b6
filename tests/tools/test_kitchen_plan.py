"""Planned paths of the kitchen's scripted demonstrator."""

from __future__ import annotations

import numpy as np
from safetensors.numpy import load_file

from suites.franka.demonstrator import FILE
from tools import kitchen_plan as planning


def test_the_stored_paths_are_those_that_are_planned() -> None:
    stored = load_file(FILE)
    for kind, draft in zip(("do", "back"), planning.light_switch(planning.Arm()), strict=True):
        np.testing.assert_allclose(stored[f"light switch/{kind}/positions"], np.stack(draft.points), atol=1e-3)
        np.testing.assert_allclose(stored[f"light switch/{kind}/commands"], draft.commands(), atol=1e-3)
