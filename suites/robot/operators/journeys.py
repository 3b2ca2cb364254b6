"""A way over several points as somebody means to go it: one stroke per point, then corrections, then rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suites.robot import constants
from suites.robot.operators.draws import Array, Draws, Integers
from suites.robot.operators.hand import Intention, Person, to_the_left

PERIOD = 1.0 / float(constants.CONTROL_RATE)
"""Seconds per control step."""


@dataclass(frozen=True)
class Pace:
    """How somebody strings strokes together; times in seconds, every number ours.

    Attributes:
        reaction: shortest and longest wait before the first stroke.
        haste: smallest and largest factor on the durations of an episode.
        blend: share of a stroke that the next one overlaps.
        look: shortest and longest look at the result before a correction.
        hesitation: probability of a pause after a stroke.
        pause: shortest and longest pause.
        rest: shortest and longest rest at the end.
        enough: metres from a point at which nobody corrects any more.
    """

    reaction: tuple[float, float] = (0.1, 0.3)
    haste: tuple[float, float] = (0.8, 1.3)
    blend: float = 0.45
    look: tuple[float, float] = (0.08, 0.2)
    hesitation: float = 0.1
    pause: tuple[float, float] = (0.15, 0.5)
    rest: tuple[float, float] = (1.0, 1.8)
    enough: float = 0.008


@dataclass(frozen=True)
class Journey:
    """What n people mean to do.

    Attributes:
        intention: where their hands mean to be.
        end: ``[n]`` seconds after which they let go, rest included.
    """

    intention: Intention
    end: Array

    def steps(self, most: int) -> Integers:
        """``[n]`` control steps, between 1 and `most`."""
        steps: Integers = np.clip(np.ceil(self.end / PERIOD), 1, most).astype(np.int64)
        return steps


def journey(person: Person, pace: Pace, draws: Draws, start: Array, points: Array) -> Journey:
    """Strokes over `points` ``[n, L, 2]`` from `start` ``[n, 2]``.

    A stroke aims at its point from where the one before it leads, errors included; so a point that comes twice is
    corrected the second time.
    """
    legs = points.shape[1]
    intention = Intention(start, legs)
    error = 1.0 + person.overshoot + draws.normal(person.spread, legs)
    sideways, bow = draws.normal(person.spread, legs), draws.normal(person.bow, legs)
    factor = np.exp(draws.normal(person.variation, legs)) * draws.uniform(*pace.haste)[:, None]
    look, pause = draws.uniform(*pace.look, legs), draws.uniform(*pace.pause, legs)
    pause *= draws.happens(pace.hesitation, legs)
    time = draws.uniform(*pace.reaction)
    done = time
    for leg in range(legs):
        way = points[:, leg] - intention.end
        distance = np.linalg.norm(way, axis=-1)
        goes = distance > pace.enough
        duration = factor[:, leg] * person.stroke_duration(distance)
        stroke = error[:, leg, None] * way + sideways[:, leg, None] * to_the_left(way)
        intention.begin(goes, time, duration, stroke, bow[:, leg])
        done = np.where(goes, time + duration, done)
        arrives = (points[:, leg] == points[:, min(leg + 1, legs - 1)]).all(-1) | (pause[:, leg] > 0.0)
        following = time + np.where(arrives, duration + look[:, leg] + pause[:, leg], (1.0 - pace.blend) * duration)
        time = np.where(goes, following, time)
    return Journey(intention, done + draws.uniform(*pace.rest))
