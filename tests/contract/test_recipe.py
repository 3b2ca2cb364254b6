"""Recipes that contradict themselves are refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from lfobench.contract.suite import Recipe


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"offline_transitions": 0}, "offline_transitions is 0"),
        ({"offline_transitions": None}, "either in transitions or in trajectories"),
        ({"offline_trajectories": 3}, "either in transitions or in trajectories"),
        ({"expert_trajectories": -1}, "expert_trajectories is -1"),
        ({"demonstration_rows": 0}, "demonstration_rows is 0"),
        ({"demonstrations": 0}, "demonstrations is 0"),
        ({"demonstration_rows": 10, "demonstrations": 2}, "either in rows"),
        ({"demonstration_rows": 10, "exact": True}, "either in rows"),
        ({"expert_transitions": 10}, "must be exact"),
        ({"expert_actions": False}, "without actions"),
    ],
)
def test_recipes_that_are_none(fields: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        replace(Recipe("mine", 5_000, "theirs", 30), **fields)
