"""Demonstrators of the generated locomotion data: random, medium and expert policies of each environment.

Weights and their cards lie in ``weights/``; ``tools/locomotion_distil.py`` in the repository makes them.
"""

from __future__ import annotations

from pathlib import Path

from lfobench.contract.suite import Demonstrator, Level
from lfobench.errors import unknown_name
from suites.demonstrators.policy import GaussianTanhPolicy, UniformPolicy

WEIGHTS = Path(__file__).parent / "weights"
ACTIONS = {"hopper": 3, "halfcheetah": 6, "walker2d": 6, "ant": 8}


def load(environment: str, level: Level) -> Demonstrator:
    """The policy of an environment (its short name, e.g. ``hopper``) and level.

    Raises:
        UserError: there is no such environment.
    """
    if environment not in ACTIONS:
        raise unknown_name("environment", environment, ACTIONS)
    if level == "random":
        return UniformPolicy(ACTIONS[environment])
    return GaussianTanhPolicy.read(WEIGHTS / f"{environment}-{level}.safetensors")
