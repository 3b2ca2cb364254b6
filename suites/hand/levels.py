"""Demonstrators of the generated data of pen, door and hammer, by level.

``expert`` was distilled from the policies behind D4RL's expert sets; ``scripted`` takes the place of people; ``cloned``
is half ``scripted``, all of it new demonstrations, and half a clone of it. Weights and their cards lie in ``weights/``;
``tools/adroit_distil.py`` in the repository makes them.
"""

from __future__ import annotations

import hashlib
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.suite import Demonstrator, FloatArray, Level
from lfobench.errors import unknown_name
from suites.demonstrators.policy import GaussianTanhPolicy

Array = NDArray[np.float64]

HAND_COLUMNS = 24
"""Leading columns of an observation that are joints of the hand, in every environment."""


def begins(observation: FloatArray) -> bool:
    """Whether an observation ``[obs]`` is an episode's first: the hand is in its initial pose, to the last bit.

    Policies get no other signal of a reset, and no step leads back to that pose.
    """
    return not observation[:HAND_COLUMNS].any()


@dataclass(frozen=True)
class Manner:
    """Differences between a person and the expert.

    Attributes:
        lag: time constant, in steps, of the command's approach to the expert's action.
        tremor: greatest std of the noise on the command; an episode has a uniform share of it.
        tremor_time: correlation time of the tremor in steps.
        pause_every: mean steps from one pause to the next.
        pause: mean steps of a pause.
        detour_every: mean steps from one detour to the next.
        detour: mean steps of a detour.
    """

    lag: float
    tremor: float
    tremor_time: float
    pause_every: float
    pause: float
    detour_every: float
    detour: float


class ScriptedPolicy:
    """A scripted person: the expert's mean action with lag, tremor, pauses and detours.

    It keeps the state of its episode; a new one acts as any other with the same generator.

    Args:
        expert: whose mean action is followed.
        manner: differences from the expert.
    """

    def __init__(self, expert: GaussianTanhPolicy, manner: Manner) -> None:
        self._expert = expert
        self._manner = manner
        self._command: Array | None = None
        self._tremor: Array = np.zeros(0)
        self._detour: Array = np.zeros(0)
        self._pausing = self._straying = False
        self._share = 0.0

    @property
    def fingerprint(self) -> str:
        """Hash of the expert, the manner and this rule."""
        rule = f"lagging command with tremor, pauses and detours, 1: {astuple(self._manner)}"
        return hashlib.sha256(f"{rule} of {self._expert.fingerprint}".encode()).hexdigest()

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """An action ``[act]`` for the next observation ``[obs]`` of an episode."""
        manner, meant = self._manner, self._expert.mean_action(observation).astype(np.float64)
        if self._command is None or begins(observation):
            self._command, self._pausing, self._straying = meant, False, False
            self._share = generator.uniform()
            self._tremor = generator.standard_normal(len(meant))
        else:
            kept = np.exp(-1.0 / manner.tremor_time)
            self._tremor = kept * self._tremor + np.sqrt(1.0 - kept**2) * generator.standard_normal(len(meant))
        chance = generator.uniform(size=2)
        self._pausing = chance[0] < (1.0 - 1.0 / manner.pause if self._pausing else 1.0 / manner.pause_every)
        strayed = self._straying
        self._straying = chance[1] < (1.0 - 1.0 / manner.detour if strayed else 1.0 / manner.detour_every)
        if self._straying and not strayed:
            self._detour = generator.uniform(-1.0, 1.0, len(meant))
        if not self._pausing:
            towards = self._detour if self._straying else meant
            self._command = self._command + (1.0 - np.exp(-1.0 / manner.lag)) * (towards - self._command)
        trembling = self._command + manner.tremor * self._share * self._tremor
        return np.clip(trembling, -1.0, 1.0).astype(np.float32)


class Halves:
    """Two policies that alternate by episodes: the one with fewer steps so far acts next, the first one at equality.

    Args:
        policies: the two, the one that begins first.
    """

    def __init__(self, *policies: Demonstrator) -> None:
        self._policies = policies
        self._steps = [0] * len(policies)
        self._acting = 0

    @property
    def fingerprint(self) -> str:
        """Hash of both policies and this rule."""
        rule = "the one of fewer steps acts, 1: " + " ".join(policy.fingerprint for policy in self._policies)
        return hashlib.sha256(rule.encode()).hexdigest()

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """An action ``[act]`` for the next observation ``[obs]`` of an episode."""
        if begins(observation):
            self._acting = int(np.argmin(self._steps))
        self._steps[self._acting] += 1
        return self._policies[self._acting].act(observation, generator)


WEIGHTS = Path(__file__).parent / "weights"
LEVELS = ("scripted", "cloned", "expert")

# Chosen so that door's return and success are about those of the human demonstrations behind D4RL's door-human where
# these are played whole, for 223 to 300 steps: a return of 794, a score of 29, success in 0.32 of them. But scripted
# episodes end at 200 steps; within those the demonstrations return 170, success in 0.28, so the scripted ones are
# better.
# Scores of people with pen and hammer are not known; the scripted ones are 30 to 45.
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
    scripted = ScriptedPolicy(expert, MANNERS[environment])
    return scripted if level == "scripted" else Halves(scripted, policy(environment, "clone"))


def policy(environment: str, name: str) -> GaussianTanhPolicy:
    """The policy of a weight file: ``expert`` or ``clone``."""
    return GaussianTanhPolicy.read(WEIGHTS / f"{environment}-{name}.safetensors")
