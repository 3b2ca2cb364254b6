"""Safe manipulation by teleoperation: an expert who goes round the cups to the bowl, and somebody who minds nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from suites.robot import constants, tasks
from suites.robot.operators.draws import Array, Draws
from suites.robot.operators.hand import MOUSE, Person
from suites.robot.operators.journeys import Pace, journey
from suites.robot.operators.mouse import drag
from suites.robot.operators.recording import Take
from suites.robot.operators.routes import Routes
from suites.robot.operators.scripted import Scripted
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW
from suites.robot.simulation import Simulation
from suites.robot.tasks import SafeManipulation

CORNER: Array = np.array([constants.CORNER_X, constants.CORNER_Y])
LIMIT = SafeManipulation.horizon
"""Steps after which a recording is cut at the latest."""


@dataclass(frozen=True)
class Care:
    """How somebody minds the cups on the way to the bowl; every number ours.

    Attributes:
        distance: metres kept free between the object and a cup.
        berth: most metres beyond that which somebody adds.
        taste: standard deviation of relative dislikes that decide between two ways round.
        aim: standard deviation in metres, per axis, of the place in the bowl that is aimed at.
        careless: probability that the cups are forgotten.
        short: probability that somebody stops short of the bowl and takes it for the bowl.
        missing: metres by which it is missed then.
    """

    distance: float = 0.032
    berth: float = 0.015
    taste: float = 0.05
    aim: float = 0.012
    careless: float = 0.01
    short: float = 0.01
    missing: float = 0.11

    def points(self, draws: Draws, start: Array, low: Array, high: Array) -> Array:
        """Points ``[n, BENDS, 2]`` of ways from `start` ``[n, 2]`` to the bowl within `low` and `high` ``[2]``."""
        routes = Routes(tasks.CUPS, tasks.CUP_REACH + self.distance, tasks.BOWL, low, high)
        bends = routes.plan(start, draws.normal(self.taste, len(routes.points)), draws.uniform(0.0, self.berth))
        back = start - tasks.BOWL
        back /= np.linalg.norm(back, axis=-1, keepdims=True)
        goal = tasks.BOWL + draws.normal(self.aim, 2) + back * self.missing * draws.happens(self.short)[:, None]
        straight = (bends == tasks.BOWL).all(-1) | draws.happens(self.careless)[:, None]
        return np.where(straight[..., None], goal[:, None], bends)


STEADY, IDLE = Pace(), Pace(haste=(0.7, 1.6), hesitation=0.25, rest=(0.4, 0.9))
CAREFUL = Care()


def starts(scatter: float | None, draws: Draws) -> Array | None:
    """``[n, 2]`` about the corner opposite the bowl; None where there is no `scatter`."""
    return None if scatter is None else CORNER + draws.normal(scatter, 2)


@dataclass(frozen=True)
class SafeTeleoperation(Scripted):
    """An expert with a mouse: goes round the cups, corrects, and rests above the bowl.

    Attributes:
        scatter: standard deviation in metres, per axis, of starts about the corner; None for the task's random starts.
        person: how the hand moves.
        pace: how it strings its strokes together.
        care: how it minds the cups.
    """

    scatter: float | None = None
    person: Person = MOUSE
    pace: Pace = STEADY
    care: Care = CAREFUL

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """That many episodes; an action is the fraction of the robot's clip that it was sent."""
        draws = Draws(generator, episodes)
        simulation = Simulation(SafeManipulation(), episodes, LIMIT + 1, ends=False)
        first = simulation.reset(draws.seeds.tolist(), starts(self.scatter, draws))
        start = simulation.effector
        points = self.care.points(draws, start, WORKSPACE_LOW, WORKSPACE_HIGH)
        way = journey(self.person, self.pace, draws, start, points)
        return drag(simulation, first, self.person, way, draws, LIMIT)


@dataclass(frozen=True)
class Wandering(Scripted):
    """Somebody who takes the arm from a random place to a random place over others, and minds neither cups nor bowl.

    Attributes:
        embodiment: what is observed: the arm, or the object that the camera tracks.
        person: how the hand moves.
        pace: how it strings its strokes together.
        points: places per episode, the last one included.
    """

    embodiment: Literal["robot", "hand"]
    person: Person = MOUSE
    pace: Pace = IDLE
    points: int = 4

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """That many episodes, none of which a cup ends."""
        draws = Draws(generator, episodes)
        simulation = Simulation(SafeManipulation(self.embodiment), episodes, LIMIT + 1, ends=False)
        places = WORKSPACE_LOW + draws.uniform(0.0, 1.0, 1 + self.points, 2) * (WORKSPACE_HIGH - WORKSPACE_LOW)
        first = simulation.reset(draws.seeds.tolist(), places[:, 0])
        way = journey(self.person, self.pace, draws, places[:, 0], places[:, 1:])
        return drag(simulation, first, self.person, way, draws, LIMIT)
