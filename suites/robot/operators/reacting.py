"""People who watch a sliding puck and decide, step by step, what the hand on the mouse does next."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from suites.robot.operators.draws import Array, Draws
from suites.robot.operators.foresight import Eyes
from suites.robot.operators.hand import Hand, Intention, Person
from suites.robot.operators.journeys import PERIOD
from suites.robot.servo import clipped_action
from suites.robot.simulation import Simulation

STROKES_AT_ONCE = 12
"""More than ever overlap."""


class Reacting(ABC):
    """n people, each before a world of their own.

    Args:
        person: how their hands move.
        delay: shortest and longest time in seconds by which what they see is late.
        simulation: just reset.
        draws: everything random.
        steps: most control steps.
    """

    def __init__(
        self, person: Person, delay: tuple[float, float], simulation: Simulation, draws: Draws, steps: int
    ) -> None:
        self.person, self.simulation = person, simulation
        self.intention = Intention(simulation.effector, STROKES_AT_ONCE)
        self.eyes = Eyes(np.rint(draws.uniform(*delay) / PERIOD).astype(np.int64))
        self.step = 0
        self._hand = Hand(person, simulation.effector, draws, steps, PERIOD)

    @abstractmethod
    def decide(self, time: float) -> None:
        """Begin strokes, now that the puck has been looked at; `time` in seconds since the start."""

    def act(self) -> Array:
        """The next action ``[n, 2]``."""
        puck, velocity = self.simulation.puck, self.simulation.puck_velocity
        assert puck is not None and velocity is not None
        self.eyes.look(puck, velocity)
        self.decide(self.step * PERIOD)
        self.step += 1
        mouse = self._hand.follow(self.intention.at(self.step * PERIOD))
        return clipped_action(mouse - self.simulation.effector)
