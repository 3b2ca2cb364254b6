"""Data of two policies, half and half, as D4RL's cloned sets are demonstrations and rollouts of their clone.

D4RL repeats the 25 demonstrations that its clone was fitted to until they fill their half. Here each policy goes on
acting: no episode comes twice, and those that the clone was fitted to are not among them.
"""

from __future__ import annotations

import hashlib

import numpy as np

from lfobench.contract.suite import Demonstrator, FloatArray
from suites.hand.scripted import begins


class Halves:
    """Whoever has made fewer steps so far acts in the next episode; the first one, where they are even.

    Args:
        policies: two, the one that begins first.
    """

    def __init__(self, *policies: Demonstrator) -> None:
        self._policies = policies
        self._steps = [0] * len(policies)
        self._acting = 0

    @property
    def fingerprint(self) -> str:
        """Of both policies and this rule."""
        rule = "the one of fewer steps acts, 1: " + " ".join(policy.fingerprint for policy in self._policies)
        return hashlib.sha256(rule.encode()).hexdigest()

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """An action ``[act]`` for the next observation ``[obs]`` of an episode."""
        if begins(observation):
            self._acting = int(np.argmin(self._steps))
        self._steps[self._acting] += 1
        return self._policies[self._acting].act(observation, generator)
