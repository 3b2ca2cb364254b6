"""Human hand motion: an intention, which is a sum of bell-shaped strokes, and a lagging, trembling hand.

Lengths in metres, times in seconds. Every array has one row per episode, n in all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suites.robot import constants

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Draws:
    """Random draws for episodes that are recorded in lock step.

    Args:
        generator: decides the episodes' seeds; the first episodes of a longer recording are those of a shorter one.
        episodes: how many, n.
    """

    def __init__(self, generator: np.random.Generator, episodes: int) -> None:
        self.episodes = episodes
        self.seeds: Integers = generator.integers(2**31, size=episodes)
        self._generators = [np.random.Generator(np.random.Philox(int(seed))) for seed in self.seeds]

    def uniform(self, low: float, high: float, *shape: int) -> Array:
        """``[n, *shape]``, uniform between `low` and `high`."""
        drawn: Array = low + (high - low) * np.stack([each.random(shape) for each in self._generators])
        return drawn

    def normal(self, scale: float, *shape: int) -> Array:
        """``[n, *shape]``, Gaussian with standard deviation `scale`."""
        drawn: Array = scale * np.stack([each.standard_normal(shape) for each in self._generators])
        return drawn

    def happens(self, probability: float, *shape: int) -> NDArray[np.bool_]:
        """``[n, *shape]``, each True with `probability`."""
        return self.uniform(0.0, 1.0, *shape) < probability


@dataclass(frozen=True)
class Person:
    """Parameters of a person's hand; every number is ours.

    Attributes:
        latency: least seconds of a stroke (Fitts's a).
        bit: seconds per bit of a stroke's difficulty (Fitts's b).
        width: metres of precision that is aimed for (Fitts's W).
        variation: standard deviation of a stroke's duration, relative.
        overshoot: mean overshoot of a stroke, relative to its length.
        spread: standard deviation of a stroke's end, relative to its length and in either direction.
        bow: standard deviation of a stroke's lateral deviation in its middle, relative to its length.
        frequency: natural frequency in hertz of the arm that follows the intention.
        damping: its damping ratio; below 1 it overshoots.
        tremor: standard deviation in metres.
        tremor_time: correlation time of the tremor in seconds.
    """

    latency: float
    bit: float
    width: float
    variation: float
    overshoot: float
    spread: float
    bow: float
    frequency: float
    damping: float
    tremor: float
    tremor_time: float

    def stroke_duration(self, distance: Array) -> Array:
        """``a + b log2(1 + D / W)`` (Fitts 1954, in MacKenzie's form of 1992), for distances of any shape."""
        seconds: Array = self.latency + self.bit * np.log2(1.0 + distance / self.width)
        return seconds


MOUSE = Person(
    latency=0.25,
    bit=0.2,
    width=0.02,
    variation=0.12,
    overshoot=0.03,
    spread=0.03,
    bow=0.04,
    frequency=2.0,
    damping=0.7,
    tremor=0.0012,
    tremor_time=0.1,
)
"""A hand on a mouse whose position maps to the table."""


QUICK_HAND = Person(
    latency=0.2,
    bit=0.1,
    width=0.03,
    variation=0.1,
    overshoot=0.0,
    spread=0.02,
    bow=0.03,
    frequency=3.0,
    damping=0.8,
    tremor=0.0012,
    tremor_time=0.1,
)
"""A hand on a mouse that strikes, at less precision."""


def minimum_jerk(phase: Array) -> Array:
    """Progress from 0 to 1 with a bell-shaped speed, for a phase from 0 to 1 (Flash & Hogan 1985)."""
    u = np.clip(phase, 0.0, 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def to_the_left(way: Array) -> Array:
    """``[n, 2]`` turned by 90 degrees."""
    return np.stack([-way[:, 1], way[:, 0]], axis=-1)


def bulge(phase: Array) -> Array:
    """Lateral deviation of a bowed stroke: 0 at either end, with no speed there, and 1 in the middle."""
    u = np.clip(phase, 0.0, 1.0)
    v: Array = 4.0 * u * (1.0 - u)
    return v * v


class Intention:
    """Intended positions of the hand: an origin plus superposed strokes (Flash & Henis 1991).

    Args:
        origin: ``[n, 2]``.
        slots: greatest number of unfinished strokes per row.
    """

    def __init__(self, origin: Array, slots: int) -> None:
        n = len(origin)
        self._origin = origin.astype(np.float64)
        self._onset = np.zeros((n, slots))
        self._duration = np.ones((n, slots))
        self._displacement = np.zeros((n, slots, 2))
        self._bow = np.zeros((n, slots, 2))
        self._next = np.zeros(n, np.int64)

    def begin(self, who: NDArray[np.bool_], onset: Array, duration: Array, displacement: Array, bow: Array) -> None:
        """Add a stroke to some rows; where no slot is free, the oldest stroke counts as finished.

        Args:
            who: ``[n]`` the rows.
            onset: ``[n]`` seconds.
            duration: ``[n]`` seconds.
            displacement: ``[n, 2]`` from its start to its end.
            bow: ``[n]`` lateral deviation to the left, relative to its length.
        """
        rows = np.flatnonzero(who)
        slots = self._next[rows]
        self._origin[rows] += self._displacement[rows, slots]
        self._onset[rows, slots] = onset[rows]
        self._duration[rows, slots] = duration[rows]
        self._displacement[rows, slots] = displacement[rows]
        self._bow[rows, slots] = (bow[:, None] * to_the_left(displacement))[rows]
        self._next[rows] = (slots + 1) % self._onset.shape[1]

    def at(self, time: float) -> Array:
        """``[n, 2]`` at one time."""
        return self.during(np.array([time]))[:, 0]

    def during(self, times: Array) -> Array:
        """``[n, T, 2]`` at times ``[T]``."""
        phase = (times[:, None] - self._onset[:, None]) / self._duration[:, None]
        place: Array = self._origin[:, None] + minimum_jerk(phase) @ self._displacement + bulge(phase) @ self._bow
        return place

    @property
    def end(self) -> Array:
        """``[n, 2]`` final positions if no stroke is added."""
        place: Array = self._origin + self._displacement.sum(1)
        return place


class Hand:
    """A damped oscillator that follows an intention, with tremor.

    Args:
        person: its parameters.
        origin: ``[n, 2]`` where it rests at first.
        draws: the tremor's.
        steps: control steps that it will make.
        period: seconds per control step.
    """

    def __init__(self, person: Person, origin: Array, draws: Draws, steps: int, period: float) -> None:
        self._position, self._velocity = origin.astype(np.float64), np.zeros_like(origin, dtype=np.float64)
        pull = 2.0 * np.pi * person.frequency
        decay, swing = person.damping * pull, pull * np.sqrt(1.0 - person.damping**2)
        # Exact over one period for an intention that holds still in it: the oscillator's closed form.
        shrink, cosine, sine = np.exp(-decay * period), np.cos(swing * period), np.sin(swing * period) / swing
        self._carry = shrink * np.array(
            [[cosine + decay * sine, sine], [-(pull**2) * sine, cosine - decay * sine]],
        )
        keep = np.exp(-period / person.tremor_time)
        self._keep, self._shocks = keep, draws.normal(person.tremor * np.sqrt(1.0 - keep**2), steps, 2)
        self._tremor, self._step = draws.normal(person.tremor, 2), 0

    def follow(self, intention: Array) -> Array:
        """``[n, 2]`` positions of the hand one period later, for an `intention` ``[n, 2]``."""
        (away, away_speed), (speed, speed_speed) = self._carry
        error = self._position - intention
        self._position = intention + away * error + away_speed * self._velocity
        self._velocity = speed * error + speed_speed * self._velocity
        self._tremor = self._keep * self._tremor + self._shocks[:, self._step]
        self._step += 1
        return self._position + self._tremor


PERIOD = 1.0 / float(constants.CONTROL_RATE)
"""Seconds per control step."""


@dataclass(frozen=True)
class Pace:
    """Timing of a sequence of strokes; times in seconds, every number ours.

    Attributes:
        reaction: shortest and longest wait before the first stroke.
        haste: smallest and largest factor on the durations of an episode.
        blend: share of a stroke that the next one overlaps.
        look: shortest and longest look at the result before a correction.
        hesitation: probability of a pause after a stroke.
        pause: shortest and longest pause.
        rest: shortest and longest rest at the end.
        enough: metres from a point within which nothing is corrected.
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
    """Planned motions of n people.

    Attributes:
        intention: positions over time.
        end: ``[n]`` seconds, rest included.
    """

    intention: Intention
    end: Array

    def steps(self, most: int) -> Integers:
        """``[n]`` control steps, between 1 and `most`."""
        steps: Integers = np.clip(np.ceil(self.end / PERIOD), 1, most).astype(np.int64)
        return steps


def journey(person: Person, pace: Pace, draws: Draws, start: Array, points: Array) -> Journey:
    """Strokes over `points` ``[n, L, 2]`` from `start` ``[n, 2]``.

    A stroke begins where the one before it ends, errors included, so a repeated point is a correction.
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
