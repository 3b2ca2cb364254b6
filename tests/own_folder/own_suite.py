"""A suite of somebody else's, whose environment lies beside it."""

from __future__ import annotations

import worlds
from own_makers import Pusher

from lfobench.contract.suite import Demonstrator, Environment, Level, Recipe, Suite, Task


def environment(actions: str = "two", observations: str = "flat", identifier: str = "Cart-v0") -> Environment:
    arguments = {"actions": actions, "observations": observations}
    return Environment(actions, f"worlds:{identifier}", 20, 0.0, 40.0, arguments)


def demonstrator(environment: str, level: Level) -> Demonstrator:
    return Pusher(worlds.actions_of(environment), level)


def task(actions: str, observations: str = "flat") -> Task:
    name = f"cart-{actions}" if observations == "flat" else f"cart-{actions}-{observations}"
    recipe = Recipe("random", 400, "expert", 2, 20)
    return Task(name, "random+expert", environment(actions, observations), recipe, 20)


SUITE = Suite(
    "own",
    "a cart with all kinds of spaces",
    (
        *(task(actions) for actions in ("two", "one", "skew", "unbounded", "half")),
        *(task(actions) for actions in ("discrete", "multidiscrete", "dict", "whole", "grid")),
        *(task("two", observations) for observations in ("dict", "image", "discrete", "tuple", "scalar")),
    ),
    demonstrator,
)
