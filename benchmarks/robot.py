"""Control steps of the robot simulation in lock step: physics, camera, rules and observations of every world."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.pairs import Spread
from lfobench.contract.suite import Environment
from lfobench.registry import load_suite

WORLDS = 64
GENTLE = 0.2
"""Largest action: full ones stop the arm by its own emergency stop."""


def control_steps(quick: bool, rounds: int) -> dict[str, Spread]:
    """Control steps per second of one thread's time, by environment of the suite; resets are not counted."""
    environments = {
        f"{each.name} {' '.join(map(str, each.arguments.values()))}".strip(): each
        for each in (task.environment for task in load_suite("airhockey").tasks)
    }
    return {name: _of(each, 10 if quick else 100, rounds) for name, each in environments.items()}


def _of(environment: Environment, steps: int, rounds: int) -> Spread:
    worlds = environment.make_many(WORLDS)
    if worlds is None:
        raise RuntimeError(f"{environment.name} has no vector form")
    actions = np.random.default_rng(0).uniform(-GENTLE, GENTLE, (steps, WORLDS, 2)).astype(np.float32)
    rates = []
    for _ in range(rounds):
        worlds.reset(seed=0)
        # The thread's own time: what others do on the machine is not the simulation's.
        started = time.thread_time()
        for action in actions:
            worlds.step(action)
        rates.append(steps * WORLDS / (time.thread_time() - started))
    worlds.close()
    return Spread.of(rates)
