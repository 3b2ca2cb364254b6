"""Recipes in identities, which never change, under a protocol's caps, in rows and as text."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from lfobench.cells.recipes import capped, described, described_parts, most_rows, recipe_identity
from lfobench.contract.suite import Recipe
from lfobench.text import content_hash

PUBLISHED = Recipe("random", 1_000_000, "expert", 200, 1000)
OWN = Recipe("mine", 5_000, "theirs", 30, demonstrations=3)
RECORDED = Recipe.recorded("suboptimal", 50, "expert", 15, expert_transitions=300, standardize=True)


def test_identities_are_those_of_older_records() -> None:
    assert recipe_identity(PUBLISHED) == {
        "offline": "random",
        "offline_transitions": 1_000_000,
        "expert": "expert",
        "expert_trajectories": 200,
        "demonstration_rows": 1000,
    }
    assert recipe_identity(RECORDED) == {
        "offline": "suboptimal",
        "offline_trajectories": 50,
        "expert": "expert",
        "expert_trajectories": 15,
        "expert_transitions": 300,
        "expert_actions": True,
        "equal_transitions": False,
        "standardize": True,
    }


def test_identities_of_counted_demonstrations() -> None:
    assert recipe_identity(OWN) == {
        "offline": "mine",
        "offline_transitions": 5_000,
        "expert": "theirs",
        "expert_trajectories": 30,
        "demonstrations": 3,
    }
    assert recipe_identity(Recipe("mine", 5_000, "theirs", 30))["demonstrations"] == 1


@pytest.mark.parametrize("recipe", [PUBLISHED, OWN, RECORDED], ids=["published", "own", "recorded"])
def test_every_field_decides_the_identity(recipe: Recipe) -> None:
    changes: dict[str, Any] = {
        "offline": "another",
        "expert": "another",
        "expert_trajectories": 7,
        "standardize": not recipe.standardize,
        "equal_transitions": True,
        **({"demonstration_rows": 999} if recipe is PUBLISHED else {"demonstrations": 7}),
        **({"exact": True} if recipe is OWN else {}),
        **({"offline_trajectories": 7} if recipe is RECORDED else {"offline_transitions": 7}),
        **({"expert_transitions": 7, "expert_actions": False} if recipe is RECORDED else {}),
    }
    found = {content_hash(recipe_identity(replace(recipe, **{name: value}))) for name, value in changes.items()}
    assert len(found | {content_hash(recipe_identity(recipe))}) == len(changes) + 1


def test_caps_are_for_what_is_counted_in_transitions() -> None:
    assert capped(PUBLISHED, 2_000, 2) == replace(PUBLISHED, offline_transitions=2_000, expert_trajectories=2)
    assert capped(PUBLISHED, None, None) == capped(PUBLISHED, 10**7, 300) == PUBLISHED
    assert capped(RECORDED, 10, 1) == RECORDED


def test_rows_are_counted_before_there_are_any() -> None:
    assert most_rows(PUBLISHED, 1000) == (1_200_000, 1000)
    assert most_rows(OWN, 200) == (5_000 + 30 * 200, 600)
    assert most_rows(RECORDED, 100) == (5_000, 300)
    assert most_rows(replace(RECORDED, expert_transitions=None, equal_transitions=True), 100) == (1_500, 1_500)


def test_descriptions() -> None:
    assert described(PUBLISHED) == "1,000,000 random transitions + 200 expert trajectories"
    assert described(OWN) == "5,000 mine transitions + 30 theirs trajectories, 3 observed"
    assert described_parts(replace(OWN, expert_trajectories=0, demonstrations=1))[1] == "1 theirs trajectory"
    assert described(RECORDED) == "50 suboptimal trajectories + 300 transitions of 15 expert trajectories"
    assert described(replace(RECORDED, equal_transitions=True)).endswith("cut to as many transitions as the latter")
