"""Contenders timed in alternation, so that load on the machine slows them all alike."""

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
    """A unit of work to time.

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
        """Ratio of the seconds of a call of `slow` to those of `fast`, round by round."""
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


@dataclass(frozen=True)
class Target:
    """One measure.

    Attributes:
        measure: its name.
        unit: of value and bounds: ``x`` for a ratio, ``s`` for seconds, ``/s`` for a rate.
        must: the bound.
        aim: the goal beyond it.
        more_is_better: whether the bounds are from below.
    """

    measure: str
    unit: str
    must: float
    aim: float
    more_is_better: bool

    def bound(self, value: float) -> str:
        """A bound as text."""
        return f"{'≥' if self.more_is_better else '≤'} {value:g}{_unit(self.unit)}"


TARGETS: dict[str, Target] = {
    "gpu seed-steps": Target(
        "GPU: DILO, hopper dimensions, batch 1024, 7 seeds: seed-steps per second over the authors' loop",
        "x", 60, 300, True,
    ),
    "gpu seeds": Target("GPU: DILO, 7 seeds over 1 seed, time per step", "x", 1.5, 1.15, False),
    "gpu cell": Target("GPU: a full `paper` cell of DILO, 7 seeds, wall", "s", 240, 60, False),
    "cpu floor": Target("CPU, one thread, float32: DILO, batch 1024, step over the floor", "x", 1.4, 1.15, False),
    "cpu authors": Target("CPU, one thread: DILO, batch 256, authors' loop over the engine", "x", 2, 3, True),
    "cpu bf16": Target("CPU with bf16 units: DILO, batch 1024, authors' loop over the engine", "x", 2.5, 5, True),
    "evaluation": Target("Evaluation, all cores over one environment at a time, per core", "x", 0.8, 1, True),
    "simulation": Target("Robot simulation, lock step, control steps per second and core", "/s", 20_000, 30_000, True),
    "loading": Target("Loading a built task of 1.2M transitions (DILO)", "s", 2, 0.3, False),
    "bootstrap": Target("50,000 bootstrap replicates of the IQM, 8 methods x 24 tasks x 7 seeds", "s", 5, 2, False),
    "records": Target("lfobench.load of 10,000 records read before", "s", 3, 1, False),
}  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """A target with its measured value, or the reason why there is none.

    Attributes:
        target: the measure.
        value: over the rounds; None where it could not be measured here.
        why_not: the reason then.
    """

    target: Target
    value: Spread | None
    why_not: str = ""

    @property
    def verdict(self) -> str:
        """By the median: ``aim``, ``must``, ``missed``, or ``unmeasured``."""
        if self.value is None:
            return "unmeasured"
        reaches: Callable[[float], bool] = (
            (lambda bound: median >= bound) if self.target.more_is_better else (lambda bound: median <= bound)
        )
        median = self.value.median
        return "aim" if reaches(self.target.aim) else "must" if reaches(self.target.must) else "missed"

    @property
    def text(self) -> str:
        """Median and extremes, or the reason."""
        if self.value is None:
            return self.why_not
        unit = _unit(self.target.unit)
        return f"{self.value.median:.3g}{unit} ({self.value.minimum:.3g} to {self.value.maximum:.3g})"

    def as_json(self) -> dict[str, Any]:
        """JSON data."""
        return {
            "measure": self.target.measure,
            "must": self.target.bound(self.target.must),
            "aim": self.target.bound(self.target.aim),
            "value": None if self.value is None else self.value.as_json(),
            "unit": self.target.unit,
            "verdict": self.verdict,
            "why_not": self.why_not,
        }


def _unit(unit: str) -> str:
    return "×" if unit == "x" else f" {unit}"
