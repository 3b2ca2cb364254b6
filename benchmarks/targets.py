"""What the engine is held to: measures, bounds, and what was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from benchmarks.pairs import Spread


@dataclass(frozen=True)
class Target:
    """One measure.

    Attributes:
        measure: in words.
        unit: of value and bounds: ``x`` for a ratio, ``s`` for seconds, ``/s`` for a rate.
        must: the bound.
        aim: what we would like.
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
    "records": Target("lfobench.load of 10,000 records seen before", "s", 3, 1, False),
}  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """A target and what was measured, or why nothing was.

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
