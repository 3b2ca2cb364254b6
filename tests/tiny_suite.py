"""A suite outside the project: a balancing pole that takes microseconds a step. Given by path, or as a plug-in."""

from __future__ import annotations

import numpy as np

from lfobench.contract.suite import Demonstrator, Environment, FloatArray, Level, Recipe, Suite, Task


class Pole:
    """Uniform pushes, or a controller that keeps the pole up (with a little noise)."""

    def __init__(self, level: Level) -> None:
        self.level = level

    @property
    def fingerprint(self) -> str:
        return f"pole {self.level}"

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        if self.level == "random":
            return generator.uniform(-1.0, 1.0, 1).astype(np.float32)
        position, angle, velocity, spin = observation
        push = 0.5 * position + 8.0 * angle + 0.5 * velocity + 1.5 * spin + generator.normal(0.0, 0.01)
        return np.asarray([np.clip(push, -1.0, 1.0)], np.float32)


def demonstrator(environment: str, level: Level) -> Demonstrator:
    return Pole(level)


POLE = Environment("pole", "InvertedPendulum-v5", 60, 5.0, 60.0)


def _task(offline: Level, trajectories: int) -> Task:
    return Task(
        name=f"pole-{offline}-expert",
        group=f"{offline}+expert",
        environment=POLE,
        recipe=Recipe(offline, 3_000, "expert", trajectories, 60),
        paper_steps=100,
    )


SUITE = Suite("tiny", "a pole, for tests", (_task("random", 20), _task("medium", 10)), demonstrator)
