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


SUCCESS_SHARES: dict[Level, float] = {
    "failing": 0.0,
    "quarter-successful": 0.25,
    "half-successful": 0.5,
    "mostly-successful": 0.75,
    "successful": 1.0,
}
"""Level to the share of its recordings that succeed, in the experts' way; the others are suboptimal and fail."""


def demonstrators() -> dict[str, dict[Level, ScriptedDemonstrator]]:
    """Environment name and level to its scripted demonstrator."""
    from suites.robot.demonstrators.hitting import Dodging, Hitting
    from suites.robot.demonstrators.manipulation import HandTrack, SafeTeleoperation, TrackedTeleoperation, Wandering
    from suites.robot.demonstrators.mixture import Mixture
    from suites.robot.demonstrators.striking import SingleStrike, VagueSwings

    def mixtures(
        skilled: ScriptedDemonstrator, suboptimal: ScriptedDemonstrator, judged: str = ""
    ) -> dict[Level, ScriptedDemonstrator]:
        return {f"{level}{judged}": Mixture(share, skilled, suboptimal) for level, share in SUCCESS_SHARES.items()}

    return {
        "safe-manipulation": {
            "expert": SafeTeleoperation(),
            "expert-fixed": SafeTeleoperation(scatter=CORNER_SCATTER),
            "suboptimal": Wandering("robot"),
            **mixtures(SafeTeleoperation(), Wandering("robot")),
        },
        "safe-manipulation-cross-embodiment": {
            "hand": HandTrack(),
            "hand-fixed": HandTrack(scatter=CORNER_SCATTER),
            "suboptimal": Wandering("hand"),
            **mixtures(TrackedTeleoperation(), Wandering("hand")),
        },
        "puck-striking": {
            "expert": SingleStrike(),
            "suboptimal": VagueSwings(),
            **mixtures(SingleStrike(), VagueSwings()),
        },
        "dynamic-hitting": {
            "expert": Hitting(),
            "expert-touch": Hitting(score="touch"),
            "expert-repeated": Hitting(single=SINGLE_HITS),
            "expert-repeated-touch": Hitting(single=SINGLE_HITS, score="touch"),
            "suboptimal": Dodging(),
            "suboptimal-touch": Dodging(score="touch"),
            **mixtures(Hitting(), Dodging()),
            **mixtures(Hitting(score="touch"), Dodging(score="touch"), "-touch"),
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
