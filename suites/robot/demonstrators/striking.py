"""Striking a puck at rest: an expert's single stroke through it, and suboptimal swings near it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suites.robot import constants, tasks
from suites.robot.demonstrators.human_motion import MOUSE, QUICK_HAND, Array, Draws, Pace, Person, journey
from suites.robot.demonstrators.planning import displacements, first_clear, mirrored
from suites.robot.demonstrators.recording import ScriptedDemonstrator, Take, drag
from suites.robot.simulation import Simulation
from suites.robot.tasks import PuckStriking

START: Array = np.array([constants.STRIKING_START_X, constants.START_Y])
LIMIT = PuckStriking.horizon
"""Steps after which a recording is cut at the latest."""

STRIKING = Pace(reaction=(0.1, 0.3), haste=(1.1, 1.6), hesitation=0.0, rest=(0.1, 0.3))
SWINGING = Pace(haste=(0.6, 1.1), blend=0.3, hesitation=0.2, rest=(0.4, 0.9))


@dataclass(frozen=True)
class SingleStrike(ScriptedDemonstrator):
    """An expert: one efficient stroke from the start pose through the puck; every number ours.

    Attributes:
        person: model of the hand.
        pace: timing of the stroke.
        aim: standard deviation in metres, per axis, of the target.
        through: shortest and longest way, in metres, of the stroke behind the puck's centre.
        short: probability that the stroke is misjudged.
        missing: share of the way that a misjudged stroke lacks.
    """

    person: Person = QUICK_HAND
    pace: Pace = STRIKING
    aim: float = 0.012
    through: tuple[float, float] = (0.0, 0.06)
    short: float = 0.02
    missing: float = 0.35

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings of `episodes` episodes."""
        draws = Draws(generator, episodes)
        simulation = Simulation(PuckStriking(), episodes, LIMIT + 1, ends=False)
        first = simulation.reset(draws.seeds.tolist())
        start, puck = simulation.effector, simulation.puck
        assert puck is not None
        towards = puck + draws.normal(self.aim, 2) - start
        distance = np.linalg.norm(towards, axis=-1)
        share = 1.0 + draws.uniform(*self.through) / distance - self.missing * draws.happens(self.short)
        stroke = start + share[:, None] * towards
        way = journey(self.person, self.pace, draws, start, stroke[:, None])
        return drag(simulation, first, self.person, way, draws, LIMIT)


@dataclass(frozen=True)
class VagueSwings(ScriptedDemonstrator):
    """A suboptimal demonstrator, who swings near the puck and seldom meets it; every number ours.

    Attributes:
        person: model of the hand.
        pace: timing of the strokes.
        swings: strokes per episode.
        near: shortest and longest distance in metres from the puck's centre at which a swing ends.
        free: metres between paddle and puck that swings keep.
        careless: probability that they do not.
        thoughts: candidate ways, of which one that avoids the puck is taken.
    """

    person: Person = MOUSE
    pace: Pace = SWINGING
    swings: int = 4
    near: tuple[float, float] = (0.1, 0.35)
    free: float = 0.03
    careless: float = 0.1
    thoughts: int = 48

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings of `episodes` episodes."""
        draws = Draws(generator, episodes)
        simulation = Simulation(PuckStriking(), episodes, LIMIT + 1, ends=False)
        first = simulation.reset(draws.seeds.tolist())
        start, puck = simulation.effector, simulation.puck
        assert puck is not None
        points = self._swings(draws, start, puck)
        way = journey(self.person, self.pace, draws, start, points)
        return drag(simulation, first, self.person, way, draws, LIMIT)

    def _swings(self, draws: Draws, start: Array, puck: Array) -> Array:
        """Ends ``[n, swings, 2]``: of several ways the first that keeps clear of the puck, or any if careless."""
        shape = (self.thoughts, self.swings)
        ends = mirrored(puck[:, None, None] + displacements(draws, *self.near, *shape))
        corners = np.concatenate([np.broadcast_to(start[:, None, None], (*ends.shape[:2], 1, 2)), ends], axis=2)
        clear = _distance(corners[:, :, :-1], corners[:, :, 1:], puck[:, None, None]).min(-1)
        wanted = np.where(draws.happens(self.careless), 0.0, tasks.PUCK_REACH + self.free)
        swings: Array = ends[np.arange(len(ends)), first_clear(clear, wanted)]
        return swings


def _distance(start: Array, end: Array, point: Array) -> Array:
    """Distance of points from straight lines, of any shapes ``[..., 2]`` that broadcast."""
    along, offset = end - start, point - start
    square = np.maximum((along * along).sum(-1), 1e-12)
    share = np.clip((offset * along).sum(-1) / square, 0.0, 1.0)
    distance: Array = np.linalg.norm(offset - share[..., None] * along, axis=-1)
    return distance
