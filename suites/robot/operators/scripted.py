"""What every scripted operator is: numbers that say how somebody acts, and a way to perform."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lfobench.contract.episodes import Episodes
from lfobench.text import content_hash
from suites.robot import constants
from suites.robot.operators.recording import Take

VERSION = 1
"""To be raised when something changes what is recorded that is neither a field nor a constant of the robot."""


@dataclass(frozen=True)
class Scripted(ABC):
    """An operator whose fields decide what it records."""

    @abstractmethod
    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Record that many episodes, and know how the rules would have judged them.

        Every episode has random numbers of its own, so a longer recording begins with the shorter one.
        """

    @property
    def fingerprint(self) -> str:
        """A hash of the kind of operator, its fields and every constant of the simulated robot."""
        return content_hash(
            {
                "version": VERSION,
                "operator": type(self).__name__,
                "fields": asdict(self),
                "constants": {name: _plain(value) for name, value in vars(constants).items() if name.isupper()},
            }
        )

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        """That many episodes."""
        return self.perform(episodes, generator).episodes


def _plain(value: Any) -> Any:
    return float(value) if isinstance(value, float) else [_plain(each) for each in value]
