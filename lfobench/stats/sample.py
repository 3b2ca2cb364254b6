"""What a test may know of one cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lfobench.stats.successes import Successes
from lfobench.stats.summary import Summary, summarize


@dataclass(frozen=True)
class Sample:
    """The scores behind one cell.

    Attributes:
        summary: n, mean and standard deviation over training seeds.
        seeds: one score per training seed ``[n]``; empty where only the summary was published.
        starts: one score per common start state ``[K]``, the mean over seeds of that start's episodes; empty where
            episodes are unknown.
        successes: how many episodes succeeded; None where scores are compared.
    """

    summary: Summary
    seeds: tuple[float, ...] = ()
    starts: tuple[float, ...] = ()
    successes: Successes | None = None


def sample_of(seeds: Sequence[float], starts: Sequence[float] = (), successes: Successes | None = None) -> Sample:
    """The sample of finite scores ``[n]``, one per seed, and ``[K]``, one per start.

    Raises:
        ValueError: there is no seed, or a score is not finite.
    """
    if starts:
        summarize(starts)
    return Sample(summarize(seeds), tuple(seeds), tuple(starts), successes)


def counted(sample: Sample) -> Successes:
    """The successes of a sample that must have them.

    Raises:
        ValueError: it has none.
    """
    if sample.successes is None:
        raise ValueError("'fisher' needs to know how every episode ended.")
    return sample.successes
