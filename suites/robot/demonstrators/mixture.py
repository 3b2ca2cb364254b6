"""Recordings of which a given share succeeds, in the experts' way; the others are suboptimal and fail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import Episodes, concatenate
from lfobench.text import content_hash
from suites.robot.demonstrators.recording import SUCCESS, Names, ScriptedDemonstrator, Take

BLOCK = 4
"""Consecutive recordings that have the share exactly, in random order."""


@dataclass(frozen=True)
class Mixture(ScriptedDemonstrator):
    """Two demonstrators, one of whom contributes successes alone and the other failures alone.

    Attributes:
        share: of successful recordings, a multiple of ``1 / BLOCK``.
        skilled: the one whose successes are taken.
        suboptimal: the one whose failures are taken.
    """

    share: float
    skilled: ScriptedDemonstrator
    suboptimal: ScriptedDemonstrator

    @property
    def fingerprint(self) -> str:
        """Hash of the share and of both demonstrators."""
        return content_hash(
            {
                "operator": type(self).__name__,
                "share": self.share,
                "block": BLOCK,
                "skilled": self.skilled.fingerprint,
                "suboptimal": self.suboptimal.fingerprint,
            }
        )

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings in random order; every block of `BLOCK` has the share."""
        order, *seeds = (int(seed) for seed in generator.integers(2**63, size=3))
        succeeds = self._order(episodes, np.random.default_rng(order))
        successes = iter(_recordings(self.skilled, True, int(succeeds.sum()), seeds[0]))
        failures = iter(_recordings(self.suboptimal, False, int((~succeeds).sum()), seeds[1]))
        chosen = [next(successes if success else failures) for success in succeeds]
        outcomes: Names = np.array([outcome for _, outcome in chosen], dtype=object)
        return Take(concatenate([recording for recording, _ in chosen]), outcomes)

    def _order(self, episodes: int, generator: np.random.Generator) -> NDArray[np.bool_]:
        """``[n]``; True where a success comes."""
        successes = np.arange(BLOCK) < round(self.share * BLOCK)
        blocks = [generator.permutation(successes) for _ in range(-(-episodes // BLOCK))]
        order: NDArray[np.bool_] = np.concatenate(blocks)[:episodes]
        return order


def _recordings(
    demonstrator: ScriptedDemonstrator, success: bool, count: int, seed: int
) -> list[tuple[Episodes, str | None]]:
    """The first `count` of a demonstrator's recordings that succeed, or that do not, each with its outcome."""
    if not count:
        return []
    attempts = count
    while True:
        take = demonstrator.perform(attempts, np.random.default_rng(seed))
        found = np.flatnonzero((take.outcomes == SUCCESS) == success)[:count]
        if len(found) == count:
            return [(take.episodes.episode(index), take.outcomes[index]) for index in found.tolist()]
        attempts += max(8, attempts // 4)
