"""Safe manipulation by teleoperation: an expert who avoids the cups, and a suboptimal demonstrator who does not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from suites.robot import constants, tasks
from suites.robot.demonstrators.human_motion import MOUSE, PERIOD, Array, Draws, Hand, Pace, Person, journey
from suites.robot.demonstrators.planning import Routes
from suites.robot.demonstrators.recording import Recording, ScriptedDemonstrator, Take, drag
from suites.robot.servo import SUBSTEPS, WORKSPACE_HIGH, WORKSPACE_LOW, Rest
from suites.robot.simulation import Camera, Simulation, pictured, stream
from suites.robot.tasks import Motion, SafeManipulation

CORNER: Array = np.array([constants.CORNER_X, constants.CORNER_Y])
LIMIT = SafeManipulation.horizon
"""Steps after which a recording is cut at the latest."""


@dataclass(frozen=True)
class Care:
    """Care for the cups on the way to the bowl; every number ours.

    Attributes:
        distance: metres kept free between the object and a cup.
        berth: greatest additional distance in metres.
        taste: standard deviation of the relative costs that decide between two ways round.
        aim: standard deviation in metres, per axis, of the target in the bowl.
        careless: probability that the cups are ignored.
        short: probability of stopping short of the bowl.
        missing: metres that are missing then.
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
class SafeTeleoperation(ScriptedDemonstrator):
    """An expert with a mouse, who goes round the cups, corrects, and rests above the bowl.

    Class attributes:
        embodiment: the arm is observed, or the object that the camera tracks.

    Attributes:
        scatter: standard deviation in metres, per axis, of starts about the corner; None for the task's random starts.
        person: model of the hand.
        pace: timing of the strokes.
        care: for the cups.
    """

    embodiment: ClassVar[Literal["robot", "hand"]] = "robot"

    scatter: float | None = None
    person: Person = MOUSE
    pace: Pace = STEADY
    care: Care = CAREFUL

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings, whose actions are fractions of the robot's clip as it was sent them."""
        draws = Draws(generator, episodes)
        simulation = Simulation(SafeManipulation(self.embodiment), episodes, LIMIT + 1, ends=False)
        first = simulation.reset(draws.seeds.tolist(), starts(self.scatter, draws))
        start = simulation.effector
        points = self.care.points(draws, start, WORKSPACE_LOW, WORKSPACE_HIGH)
        way = journey(self.person, self.pace, draws, start, points)
        return drag(simulation, first, self.person, way, draws, LIMIT)


@dataclass(frozen=True)
class TrackedTeleoperation(SafeTeleoperation):
    """The same expert, of whose work the camera's track of the object is observed in place of the arm."""

    embodiment: ClassVar[Literal["robot", "hand"]] = "hand"


@dataclass(frozen=True)
class Wandering(ScriptedDemonstrator):
    """A suboptimal demonstrator, who moves the arm over random places and ignores cups and bowl.

    Attributes:
        embodiment: the arm is observed, or the object that the camera tracks.
        person: model of the hand.
        pace: timing of the strokes.
        points: places per episode, the last one included.
    """

    embodiment: Literal["robot", "hand"]
    person: Person = MOUSE
    pace: Pace = IDLE
    points: int = 4

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings, none of which a cup ends."""
        draws = Draws(generator, episodes)
        simulation = Simulation(SafeManipulation(self.embodiment), episodes, LIMIT + 1, ends=False)
        places = WORKSPACE_LOW + draws.uniform(0.0, 1.0, 1 + self.points, 2) * (WORKSPACE_HIGH - WORKSPACE_LOW)
        first = simulation.reset(draws.seeds.tolist(), places[:, 0])
        way = journey(self.person, self.pace, draws, places[:, 0], places[:, 1:])
        return drag(simulation, first, self.person, way, draws, LIMIT)


BARE_HAND = Person(
    latency=0.15,
    bit=0.12,
    width=0.02,
    variation=0.08,
    overshoot=0.01,
    spread=0.02,
    bow=0.04,
    frequency=4.0,
    damping=0.9,
    tremor=0.0008,
    tremor_time=0.1,
)
"""A hand that carries the object itself: faster and smoother than by mouse."""

LOW: Array = np.array([0.0, -constants.TABLE_WIDTH / 2])
HIGH: Array = np.array([constants.TABLE_LENGTH, constants.TABLE_WIDTH / 2])

FLUENT = Pace(haste=(1.0, 1.6), blend=0.5, look=(0.05, 0.12), hesitation=0.05, pause=(0.2, 0.8), rest=(0.8, 1.4))
DEFT = Care(distance=0.028, berth=0.01, careless=0.008, short=0.008)


@dataclass(frozen=True)
class HandTrack(ScriptedDemonstrator):
    """An expert's bare hand, anywhere on the table: without an arm's limits, and without actions.

    Attributes:
        scatter: standard deviation in metres, per axis, of starts about the corner; None for the task's random starts.
        person: model of the hand.
        pace: timing of the strokes.
        care: for the cups.
        rail: least distance in metres between the object's centre and a rail.
    """

    scatter: float | None = None
    person: Person = BARE_HAND
    pace: Pace = FLUENT
    care: Care = DEFT
    rail: float = 0.04

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings by the camera; their actions are NaN."""
        task, draws = SafeManipulation("hand"), Draws(generator, episodes)
        seeds = draws.seeds.tolist()
        start = starts(self.scatter, draws)
        if start is None:
            start = np.array([task.start(stream(seed, "start")).effector for seed in seeds])
        points = self.care.points(draws, start, LOW + self.rail, HIGH - self.rail)
        way = journey(self.person, self.pace, draws, start, points)
        lengths = way.steps(LIMIT)
        camera, rest = Camera(seeds, LIMIT + 1), Rest(start)
        hand = Hand(self.person, start, draws, LIMIT, PERIOD)
        recording = Recording(camera.read(start).astype(np.float32))
        nothing, here = np.full((episodes, 2), np.nan, np.float32), start
        share = np.arange(1, SUBSTEPS + 1)[:, None] / SUBSTEPS
        none = np.zeros(episodes, np.bool_)
        for step in range(int(lengths.max())):
            before, here = here, hand.follow(way.intention.at((step + 1) * PERIOD))
            path = before[:, None] + share * (here - before)[:, None]
            codes = task.judge(Motion(path, None, None, rest.update(here), none, none))
            recording.add(nothing, camera.read(pictured(path)).astype(np.float32), tasks.outcome_names(codes))
        return recording.stopped(lengths)
