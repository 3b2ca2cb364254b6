"""The card beside a weight file: how it was made, what was measured, and the bars that it meets."""

from __future__ import annotations

import dataclasses
import hashlib
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

from lfobench.contract.suite import Environment, Level
from suites.demonstrators.dagger import Settings
from suites.demonstrators.measure import measure, without_noise
from suites.demonstrators.policy import GaussianTanhPolicy
from suites.demonstrators.teacher import Teacher

EXPERT_BAR = 90.0
# D4RL's reference return for ant is far below what a good policy reaches.
EXPERT_BARS = {"ant": 110.0}
MEDIUM_TOLERANCE = 10.0
LIBRARIES = ("numpy", "torch", "gymnasium", "mujoco")


def make_card(
    environment: Environment,
    level: Level,
    weights: bytes,
    command: str,
    method: str,
    settings: Mapping[str, Any],
    origin: Mapping[str, Any],
    libraries: Sequence[str] = LIBRARIES,
    episodes: int = 100,
) -> dict[str, Any]:
    """Everything a reader needs to trust or remake the weights, which are measured here.

    Args:
        environment: where the level is measured.
        level: what the weights are to be.
        weights: the weight file's bytes.
        command: what makes them again.
        method: how they were fitted, in a line.
        settings: of the method, all of them.
        origin: what they were fitted to, by the field's name on the card.
        libraries: whose versions decide weights and level.
        episodes: per measurement.
    """
    return {
        "environment": dataclasses.asdict(environment),
        "level": level,
        "sha256": hashlib.sha256(weights).hexdigest(),
        "licence": "MIT",
        "made_with": command,
        "method": method,
        "settings": dict(settings),
        **origin,
        "levels": _levels(environment, GaussianTanhPolicy(weights), episodes),
        "versions": {"python": platform.python_version(), **{library: version(library) for library in libraries}},
    }


def make_student_card(
    environment: Environment,
    level: Level,
    weights: bytes,
    teacher: Teacher,
    settings: Settings,
    command: str,
    libraries: Sequence[str] = LIBRARIES,
    episodes: int = 100,
) -> dict[str, Any]:
    """The card of weights that were distilled from a teacher, which is measured too; see `make_card`."""
    method = "DAgger (arXiv:1011.0686) from the teacher's mean and std to a Gaussian tanh MLP"
    origin = {"teacher": {**teacher.provenance, "levels": _levels(environment, teacher, episodes)}}
    fields = dataclasses.asdict(settings)
    return make_card(environment, level, weights, command, method, fields, origin, libraries, episodes)


def _levels(
    environment: Environment, policy: Teacher | GaussianTanhPolicy, episodes: int
) -> dict[str, dict[str, float]]:
    actors = {"sampled": policy.act, "deterministic": without_noise(policy.mean_action)}
    return {name: dataclasses.asdict(measure(environment, act, episodes)) for name, act in actors.items()}


def shortfall(card: Mapping[str, Any]) -> str:
    """What keeps the carded weights from their level, or nothing.

    An expert reaches the bar with actions sampled and without; a medium policy's sampled score is within
    ``MEDIUM_TOLERANCE`` of its teacher's.
    """
    scores = {name: level["score_mean"] for name, level in card["levels"].items()}
    if card["level"] == "expert":
        bar = EXPERT_BARS.get(card["environment"]["name"], EXPERT_BAR)
        below = [f"{score:.1f} {name}" for name, score in scores.items() if score < bar]
        return f"an expert scores at least {bar:.0f}, this one {' and '.join(below)}" if below else ""
    goal = card["teacher"]["levels"]["sampled"]["score_mean"]
    if abs(scores["sampled"] - goal) > MEDIUM_TOLERANCE:
        return f"its teacher scores {goal:.1f}, this one {scores['sampled']:.1f}"
    return ""
