"""Recipes as the harness uses them: identity, caps of a protocol, greatest size, description."""

from __future__ import annotations

from dataclasses import MISSING, fields, replace
from typing import Any

from lfobench.contract.suite import Recipe
from lfobench.text import counted


def recipe_identity(recipe: Recipe) -> dict[str, Any]:
    """The recipe in a run's identity, as plain JSON data; it must never change, because records are found by it.

    A recipe that counts its offline part in trajectories calls its demonstrations `expert_trajectories`, and always
    names more of its fields; other fields are named where they differ from their defaults.
    """
    defaults = {each.name: each.default for each in fields(recipe) if each.default is not MISSING}
    always = {"offline", "expert", "expert_trajectories"}
    values = dict(vars(recipe))
    if recipe.offline_trajectories is None:
        counted_in = "demonstrations" if recipe.demonstration_rows is None else "demonstration_rows"
        always |= {"offline_transitions", counted_in}
    else:
        defaults |= {"offline_transitions": None, "expert_trajectories_joined": 0, "exact": True}
        values["expert_trajectories_joined"] = recipe.expert_trajectories
        values["expert_trajectories"] = values.pop("demonstrations")
        always |= {"offline_trajectories", "expert_transitions", "expert_actions"}
        always |= {"equal_transitions", "standardize"}
    return {name: value for name, value in values.items() if name in always or value != defaults[name]}


def capped(recipe: Recipe, transitions: int | None, trajectories: int | None) -> Recipe:
    """The recipe with at most so many offline transitions and joining expert trajectories; None is no cap.

    A recipe that counts its offline part in trajectories is small, and keeps its size.
    """
    if recipe.offline_transitions is None:
        return recipe
    return replace(
        recipe,
        offline_transitions=min(recipe.offline_transitions, transitions or recipe.offline_transitions),
        expert_trajectories=min(recipe.expert_trajectories, trajectories or recipe.expert_trajectories),
    )


def sizes(recipe: Recipe) -> dict[str, int]:
    """Amounts that `capped` may reduce, by name."""
    return {
        "offline_transitions": recipe.offline_transitions or 0,
        "expert_trajectories": recipe.expert_trajectories,
    }


def most_rows(recipe: Recipe, horizon: int) -> tuple[int, int]:
    """Offline and expert rows to train on, if every trajectory runs to the horizon."""
    observed = recipe.observed * horizon
    offline = recipe.offline_transitions or (recipe.offline_trajectories or 0) * horizon
    if recipe.equal_transitions:
        offline = observed
    return (
        offline + recipe.expert_trajectories * horizon,
        recipe.demonstration_rows or recipe.expert_transitions or observed,
    )


def described_parts(recipe: Recipe) -> tuple[str, str]:
    """Descriptions of the offline part and of the expert's."""
    many = f"{recipe.expert} trajectories"
    offline = (
        f"{recipe.offline_trajectories} {recipe.offline} trajectories"
        if recipe.offline_transitions is None
        else f"{recipe.offline_transitions:,} {recipe.offline} transitions"
    )
    joined = counted(recipe.expert_trajectories, f"{recipe.expert} trajectory", many)
    if recipe.demonstration_rows is not None:
        return offline, joined
    sample = "" if recipe.expert_transitions is None else f"{recipe.expert_transitions} transitions of "
    if not recipe.expert_trajectories:
        return offline, sample + counted(recipe.demonstrations, f"{recipe.expert} trajectory", many)
    return offline, f"{joined}, {sample}{recipe.demonstrations} observed"


def described(recipe: Recipe) -> str:
    """Description of both parts, and of a cut."""
    cut = ", the former cut to as many transitions as the latter" if recipe.equal_transitions else ""
    return f"{' + '.join(described_parts(recipe))}{cut}"
