"""Stand-ins for people who moved the hand by a glove: an expert whose command reaches the fingers as a person's would.

Late and blurred, with a tremor, with pauses, and with stretches in which the hand goes where it has no business. How
much of each is drawn anew for every episode, so that some of them succeed.
"""

from __future__ import annotations

import hashlib
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.suite import FloatArray
from suites.demonstrators.policy import GaussianTanhPolicy

Array = NDArray[np.float64]

HAND_COLUMNS = 24
"""Leading columns of an observation that are joints of the hand, in every environment."""


def begins(observation: FloatArray) -> bool:
    """Whether an episode starts in this observation ``[obs]``: the hand is in its first pose, to the last bit.

    Nothing else tells a policy of a reset, and no step leads back there.
    """
    return not observation[:HAND_COLUMNS].any()


@dataclass(frozen=True)
class Manner:
    """How a person differs from the expert.

    Attributes:
        lag: steps in which the command covers 63 % of the way to the expert's.
        tremor: std of the noise on the command at its worst; an episode has a uniform share of it.
        tremor_time: steps over which the tremor forgets.
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


class Scripted:
    """A policy with a memory of its episode; a fresh one acts as any other with the same generator.

    Args:
        expert: whose mean action it means to do.
        manner: see there.
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
        """Of the expert, the manner and this rule."""
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
