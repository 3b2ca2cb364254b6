"""Scripted demonstrators of the robot tasks: models of people with a mouse, experts and suboptimal ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lfobench.contract.suite import Level
from lfobench.errors import unknown_name

if TYPE_CHECKING:
    from suites.robot.demonstrators.recording import ScriptedDemonstrator

CORNER_SCATTER = 0.012
"""Standard deviation, in metres per axis, of the starts from one corner; ours."""

SINGLE_HITS = 50
"""Recordings of a single hit in the paper's appendix; those after them are of repeated hits."""


def demonstrators() -> dict[str, dict[Level, ScriptedDemonstrator]]:
    """Environment name and level to its scripted demonstrator."""
    from suites.robot.demonstrators.hitting import Dodging, Hitting
    from suites.robot.demonstrators.manipulation import HandTrack, SafeTeleoperation, Wandering
    from suites.robot.demonstrators.striking import SingleStrike, VagueSwings

    return {
        "safe-manipulation": {
            "expert": SafeTeleoperation(),
            "expert-fixed": SafeTeleoperation(scatter=CORNER_SCATTER),
            "suboptimal": Wandering("robot"),
        },
        "safe-manipulation-cross-embodiment": {
            "hand": HandTrack(),
            "hand-fixed": HandTrack(scatter=CORNER_SCATTER),
            "suboptimal": Wandering("hand"),
        },
        "puck-striking": {"expert": SingleStrike(), "suboptimal": VagueSwings()},
        "dynamic-hitting": {
            "expert": Hitting(),
            "expert-touch": Hitting(score="touch"),
            "expert-repeated": Hitting(single=SINGLE_HITS),
            "expert-repeated-touch": Hitting(single=SINGLE_HITS, score="touch"),
            "suboptimal": Dodging(),
            "suboptimal-touch": Dodging(score="touch"),
        },
    }


def demonstrator(environment: str, level: Level) -> ScriptedDemonstrator:
    """The scripted demonstrator of an environment (its short name, e.g. ``puck-striking``) and level.

    Raises:
        UserError: there is no such environment or level.
    """
    known = demonstrators()
    if environment not in known:
        raise unknown_name("environment", environment, known)
    if level not in known[environment]:
        raise unknown_name("level", level, known[environment])
    return known[environment][level]
