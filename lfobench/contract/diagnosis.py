"""What the trajectory doctor says of a data file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["problem", "caution", "note"]
"""A problem keeps a file from being used; a caution changes what is learnt or known from it; a note does neither."""


@dataclass(frozen=True)
class Finding:
    """One thing that was found.

    Attributes:
        severity: how much it matters.
        code: a word for scripts.
        count: how often.
        text: a sentence.
    """

    severity: Severity
    code: str
    count: int
    text: str


@dataclass(frozen=True)
class Mode:
    """What a boundary mode makes of the rows.

    Attributes:
        name: e.g. ``released triples``.
        kept: rows that it yields.
        dropped: why other rows are not among them, and how many.
        odd: what is true of some of the kept ones, and of how many.
    """

    name: str
    kept: int
    dropped: dict[str, int]
    odd: dict[str, int]


@dataclass(frozen=True)
class Diagnosis:
    """A file, examined.

    Attributes:
        format: ``d4rl``, ``minari``, ``robomimic``, ``npz`` or ``lerobot``; ``cached`` of a part that was read or made
            before.
        observation: columns of an observation.
        action: columns of an action.
        lengths: steps of every episode.
        returns: of every episode; empty where rewards are missing or not finite.
        terminations: of every episode, whether it ended by itself.
        timeouts: whether the file says which episodes time ended; where it does not, those that did not end by
            themselves may have ended in any way.
        horizon: steps after which the environment cuts an episode; None where that is not known.
        findings: most severe first.
        modes: what every boundary mode yields.
    """

    format: str
    observation: int
    action: int
    lengths: tuple[int, ...]
    returns: tuple[float, ...]
    terminations: tuple[bool, ...]
    timeouts: bool
    horizon: int | None
    findings: tuple[Finding, ...]
    modes: tuple[Mode, ...]

    @property
    def terminated(self) -> int:
        """Episodes that ended by themselves."""
        return sum(self.terminations)

    @property
    def usable(self) -> bool:
        """Whether nothing keeps it from being trained on."""
        return all(finding.severity != "problem" for finding in self.findings)
