"""Contenders timed in alternation, so that what slows the machine slows them all alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch

CPU = torch.device("cpu")


@dataclass(frozen=True)
class Contender:
    """Something to time.

    Attributes:
        name: unique among those it is timed with.
        call: does one unit of work.
        period: calls after which its work repeats (delayed updates); a block is whole periods.
    """

    name: str
    call: Callable[[], object]
    period: int = 1


@dataclass(frozen=True)
class Spread:
    """Extremes and median of some repetitions."""

    minimum: float
    median: float
    maximum: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """The spread of at least one value."""
        return cls(min(values), statistics.median(values), max(values))

    def as_json(self) -> dict[str, float]:
        """JSON data, four significant digits."""
        return {name: float(f"{value:.4g}") for name, value in vars(self).items()}

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.minimum:.3g} to {self.maximum:.3g})"


@dataclass(frozen=True)
class Timing:
    """One contender's rounds.

    Attributes:
        name: the contender's.
        calls: in each block.
        seconds: per call, one entry per round.
    """

    name: str
    calls: int
    seconds: tuple[float, ...]

    @property
    def spread(self) -> Spread:
        """Seconds per call over the rounds."""
        return Spread.of(self.seconds)

    def as_json(self) -> dict[str, Any]:
        """JSON data; every round is kept, so that another statistic can be taken later."""
        return {
            "name": self.name,
            "calls": self.calls,
            "seconds_per_call": self.spread.as_json(),
            "rounds": [float(f"{value:.4g}") for value in self.seconds],
        }


@dataclass(frozen=True)
class Alternation:
    """Contenders timed together, by name."""

    timings: Mapping[str, Timing]

    def ratio(self, slow: str, fast: str) -> Spread:
        """How many times longer a call of `slow` takes than one of `fast`, round by round."""
        pairs = zip(self.timings[slow].seconds, self.timings[fast].seconds, strict=True)
        return Spread.of([ours / theirs for ours, theirs in pairs])

    def as_json(self) -> list[dict[str, Any]]:
        """JSON data, in the order of the contenders."""
        return [timing.as_json() for timing in self.timings.values()]


def alternate(
    contenders: Sequence[Contender],
    *,
    rounds: int,
    block_seconds: float = 0.5,
    calls: int | None = None,
    warm_up: int = 3,
    device: torch.device = CPU,
) -> Alternation:
    """Time blocks of calls in the order A B C, A B C, ...

    Args:
        contenders: what to time; all stay alive throughout.
        rounds: blocks per contender.
        block_seconds: about how long a block lasts; decides each contender's calls once, after the warm-up.
        calls: calls per block, instead of `block_seconds`.
        warm_up: periods that every contender runs before anything is timed.
        device: synchronised before the clock is read, if it runs apart from the host.
    """
    if len({contender.name for contender in contenders}) < len(contenders):
        raise ValueError("contenders need names of their own")
    for contender in contenders:
        _block(contender, warm_up * contender.period, device)
    counts = {
        contender.name: _whole_periods(contender, calls or _calls_for(contender, block_seconds, device))
        for contender in contenders
    }
    seconds: dict[str, list[float]] = {contender.name: [] for contender in contenders}
    for _ in range(rounds):
        for contender in contenders:
            count = counts[contender.name]
            seconds[contender.name].append(_block(contender, count, device) / count)
    return Alternation({name: Timing(name, counts[name], tuple(found)) for name, found in seconds.items()})


def _calls_for(contender: Contender, block_seconds: float, device: torch.device) -> int:
    once = _block(contender, contender.period, device) / contender.period
    return max(1, round(block_seconds / once))


def _whole_periods(contender: Contender, calls: int) -> int:
    return -(-calls // contender.period) * contender.period


def _block(contender: Contender, calls: int, device: torch.device) -> float:
    """Seconds of `calls` calls, from an idle device to an idle device."""
    _synchronize(device)
    started = time.perf_counter()
    for _ in range(calls):
        contender.call()
    _synchronize(device)
    return time.perf_counter() - started


def _synchronize(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
