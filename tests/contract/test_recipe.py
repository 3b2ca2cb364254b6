"""Recipes: one type for everything that counts data; what old records say of it stays the same to the letter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from lfobench.contract.suite import Recipe
from lfobench.text import content_hash

PUBLISHED = Recipe("random", 1_000_000, "expert", 200, 1000)
OWN = Recipe("mine", 5_000, "theirs", 30, demonstrations=3)
RECORDED = Recipe.recorded("suboptimal", 50, "expert", 15, expert_transitions=300, standardize=True)


def test_identities_are_those_of_older_records() -> None:
    assert PUBLISHED.identity == {
        "offline": "random",
        "offline_transitions": 1_000_000,
        "expert": "expert",
        "expert_trajectories": 200,
        "demonstration_rows": 1000,
    }
    assert RECORDED.identity == {
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
    assert OWN.identity == {
        "offline": "mine",
        "offline_transitions": 5_000,
        "expert": "theirs",
        "expert_trajectories": 30,
        "demonstrations": 3,
    }
    assert Recipe("mine", 5_000, "theirs", 30).identity["demonstrations"] == 1


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
    found = {content_hash(replace(recipe, **{name: value}).identity) for name, value in changes.items()}
    assert len(found | {content_hash(recipe.identity)}) == len(changes) + 1


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


def test_caps_are_for_what_is_counted_in_transitions() -> None:
    assert PUBLISHED.capped(2_000, 2) == replace(PUBLISHED, offline_transitions=2_000, expert_trajectories=2)
    assert PUBLISHED.capped(None, None) == PUBLISHED.capped(10**7, 300) == PUBLISHED
    assert RECORDED.capped(10, 1) == RECORDED


def test_rows_are_counted_before_there_are_any() -> None:
    assert PUBLISHED.most_rows(1000) == (1_200_000, 1000)
    assert OWN.most_rows(200) == (5_000 + 30 * 200, 600)
    assert RECORDED.most_rows(100) == (5_000, 300)
    assert replace(RECORDED, expert_transitions=None, equal_transitions=True).most_rows(100) == (1_500, 1_500)


def test_recipes_in_words() -> None:
    assert PUBLISHED.sentence == "1,000,000 random transitions + 200 expert trajectories"
    assert OWN.sentence == "5,000 mine transitions + 30 theirs trajectories, 3 observed"
    assert replace(OWN, expert_trajectories=0, demonstrations=1).words[1] == "1 theirs trajectory"
    assert RECORDED.sentence == "50 suboptimal trajectories + 300 transitions of 15 expert trajectories"
    assert replace(RECORDED, equal_transitions=True).sentence.endswith("cut to as many transitions as the latter")
