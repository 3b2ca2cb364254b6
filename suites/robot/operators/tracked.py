"""Safe manipulation by hand: the object is carried over the table, and nothing but the camera knows where it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suites.robot import constants, outcomes
from suites.robot.camera import Camera, pictured
from suites.robot.operators.draws import Array, Draws
from suites.robot.operators.hand import Hand, Person
from suites.robot.operators.journeys import PERIOD, Pace, journey
from suites.robot.operators.manipulation import LIMIT, Care, starts
from suites.robot.operators.recording import Recording, Take
from suites.robot.operators.scripted import Scripted
from suites.robot.rest import Rest
from suites.robot.servo import SUBSTEPS
from suites.robot.streams import stream
from suites.robot.tasks import Motion, SafeManipulation

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
class HandTrack(Scripted):
    """An expert's bare hand, anywhere on the table: no arm limits it, and there are no actions.

    Attributes:
        scatter: standard deviation in metres, per axis, of starts about the corner; None for the task's random starts.
        person: how the hand moves.
        pace: how it strings its strokes together.
        care: how it minds the cups.
        rail: metres that the object's centre keeps from a rail.
    """

    scatter: float | None = None
    person: Person = BARE_HAND
    pace: Pace = FLUENT
    care: Care = DEFT
    rail: float = 0.04

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """That many episodes, observed by the camera; their actions are NaN."""
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
            recording.add(nothing, camera.read(pictured(path)).astype(np.float32), outcomes.named(codes))
        return recording.stopped(lengths)
