"""Who makes the generated data of pen, door and hammer, level by level.

``expert`` was distilled from the policies behind D4RL's expert sets; ``scripted`` stands in for people; ``cloned`` is
half ``scripted``, all of it new demonstrations, and half a clone of it. Weights and their cards lie in ``weights/``;
``distil.py`` makes them.
"""

from __future__ import annotations

from pathlib import Path

from lfobench.contract.suite import Demonstrator, Level
from lfobench.errors import unknown_name
from suites.demonstrators.policy import GaussianTanhPolicy
from suites.hand.halves import Halves
from suites.hand.scripted import Manner, Scripted

WEIGHTS = Path(__file__).parent / "weights"
LEVELS = ("scripted", "cloned", "expert")

# Chosen so that door's return and success are about those of the human demonstrations behind D4RL's door-human where
# these are played whole, for 223 to 300 steps: a return of 794, a score of 29, success in 0.32 of them. But scripted
# episodes end at 200 steps; within those the demonstrations return 170, success in 0.28, so the stand-in is the better.
# What people reach with pen and hammer is not known here; their stand-ins score 30 to 45.
MANNERS = {
    "pen": Manner(lag=16, tremor=0.4, tremor_time=8, pause_every=60, pause=10, detour_every=80, detour=5),
    "door": Manner(lag=13, tremor=0.07, tremor_time=8, pause_every=100, pause=5, detour_every=300, detour=4),
    "hammer": Manner(lag=4.5, tremor=0.2, tremor_time=8, pause_every=60, pause=10, detour_every=150, detour=4),
}


def demonstrator(environment: str, level: Level) -> Demonstrator:
    """The policy of an environment (its short name, e.g. ``pen``) and level.

    Raises:
        UserError: there is no such environment or level.
    """
    if environment not in MANNERS:
        raise unknown_name("environment", environment, MANNERS)
    if level not in LEVELS:
        raise unknown_name("level", level, LEVELS)
    expert = policy(environment, "expert")
    if level == "expert":
        return expert
    scripted = Scripted(expert, MANNERS[environment])
    return scripted if level == "scripted" else Halves(scripted, policy(environment, "clone"))


def policy(environment: str, name: str) -> GaussianTanhPolicy:
    """The policy of a weight file: ``expert`` or ``clone``."""
    return GaussianTanhPolicy.read(WEIGHTS / f"{environment}-{name}.safetensors")
