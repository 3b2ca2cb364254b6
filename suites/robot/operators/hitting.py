"""Hitting a puck that slides down: somebody who foresees where it comes, waits there and strikes it back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from suites.robot import tasks
from suites.robot.operators.draws import Draws
from suites.robot.operators.foresight import crossing
from suites.robot.operators.hand import QUICK_HAND, Person
from suites.robot.operators.journeys import PERIOD
from suites.robot.operators.reacting import Reacting
from suites.robot.operators.recording import Recording, Take, scored
from suites.robot.operators.scripted import Scripted
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW
from suites.robot.simulation import Simulation
from suites.robot.tasks import DynamicHitting

SINGLE_LIMIT = DynamicHitting.horizon
"""Steps after which a recording of one hit is cut at the latest."""
REPEATED_LIMIT = 2000
"""Steps after which a recording of repeated hits is cut (methods.md, section 7)."""
SHORTEST_RALLY = 16
"""Steps between two strikes at the least."""


@dataclass(frozen=True)
class Skill:
    """How somebody plays; lengths in metres, times in seconds, every number ours.

    Attributes:
        delay: shortest and longest time by which what is seen is late.
        horizon: how far ahead the puck is foreseen.
        line: least and greatest x at which somebody likes to meet the puck.
        behind: how far behind that line the paddle waits.
        through: how far beyond it the strike goes.
        strike: shortest and longest duration of a strike.
        lag: how late hand and arm are known to be.
        timing: standard deviation of when the strike begins.
        doubt: standard deviation, across the table and per second still to go, of where the puck is expected.
        aim: standard deviation of where the strike goes, across the table.
        look: shortest and longest time between two corrections while waiting.
        tolerance: what is not worth a correction.
        lapse: probability that a strike is misjudged, across the table.
        missing: by how much it is then.
        recover: time after the strike's end before the paddle goes back.
        linger: shortest and longest time that the recording goes on after its last event.
    """

    delay: tuple[float, float] = (0.15, 0.22)
    horizon: float = 2.0
    line: tuple[float, float] = (0.6, 0.8)
    behind: float = 0.12
    through: float = 0.1
    strike: tuple[float, float] = (0.36, 0.5)
    lag: float = 0.2
    timing: float = 0.03
    doubt: float = 0.06
    aim: float = 0.015
    look: tuple[float, float] = (0.15, 0.35)
    tolerance: float = 0.015
    lapse: float = 0.012
    missing: float = 0.12
    recover: float = 0.1
    linger: tuple[float, float] = (0.2, 0.6)


SKILL = Skill()


@dataclass(frozen=True)
class Hitting(Scripted):
    """An expert at the table.

    Attributes:
        single: so many of the first episodes end after one hit; None for all. The later ones go on until the puck
            gets past or 2000 steps are made.
        person: how the hand moves.
        skill: how it is used.
        score: what counts as a success; the hand plays to hit either way.
    """

    single: int | None = None
    person: Person = QUICK_HAND
    skill: Skill = SKILL
    score: Literal["touch", "hit"] = "hit"

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """That many episodes; the rules of a hit decide when one of them stops."""
        draws = Draws(generator, episodes)
        once = np.arange(episodes) < (episodes if self.single is None else self.single)
        limit = SINGLE_LIMIT if self.single is None else REPEATED_LIMIT
        simulation = Simulation(DynamicHitting("hit"), episodes, limit + 1, ends=False)
        recording = Recording(simulation.reset(draws.seeds.tolist()))
        player = Player(self.person, self.skill, simulation, draws, limit)
        last = np.where(once, SINGLE_LIMIT, limit)
        linger = np.ceil(draws.uniform(*self.skill.linger) / PERIOD).astype(np.int64)
        over = np.zeros(episodes, np.bool_)
        for step in range(1, limit + 1):
            action = player.act()
            result = simulation.step(action)
            recording.add(action, result.observation, scored(result.outcome, simulation.touched, self.score))
            ends = ~over & (player.past() | (once & result.outcome.astype(np.bool_)))
            last[ends] = np.minimum(last[ends], step + linger[ends])
            over |= ends
            if (step >= last).all():
                break
        return recording.stopped(last)


class Player(Reacting):
    """n people who each watch a puck and move a mouse.

    Args:
        person: how the hands move.
        skill: how they are used.
        simulation: just reset.
        draws: every look's and every strike's.
        steps: most control steps.
    """

    def __init__(self, person: Person, skill: Skill, simulation: Simulation, draws: Draws, steps: int) -> None:
        n, strikes = draws.episodes, steps // SHORTEST_RALLY + 2
        super().__init__(person, skill.delay, simulation, draws, steps)
        self._skill = skill
        self._line, self._duration = draws.uniform(*skill.line, strikes), draws.uniform(*skill.strike, strikes)
        self._early = draws.normal(skill.timing, strikes)
        lapse = skill.missing * draws.happens(skill.lapse, strikes) * np.sign(draws.uniform(-1.0, 1.0, strikes))
        self._aside = draws.normal(skill.aim, strikes) + lapse
        self._look, self._doubt = draws.uniform(*skill.look, steps), draws.normal(skill.doubt, steps)
        self._bow = draws.normal(person.bow, steps)
        self._next_look, self._busy = np.zeros(n), np.zeros(n)
        self._rows, self._strikes = np.arange(n), np.zeros(n, np.int64)

    def past(self) -> NDArray[np.bool_]:
        """``[n]`` whose puck is out of reach for good."""
        puck = self.simulation.puck
        assert puck is not None
        return puck[:, 0] < tasks.LOST_X

    def decide(self, time: float) -> None:
        """Strike when the puck is about to come, else wait behind the line where it is expected."""
        skill, strike = self._skill, (self._rows, self._strikes)
        ahead = round(skill.horizon / PERIOD)
        line, duration = self._line[strike], self._duration[strike]
        steps, place = crossing(self.eyes.foresee(ahead), line)
        comes, free = steps <= ahead, time >= self._busy
        guess = place + self._aside[strike] + self._doubt[:, self.step] * steps * PERIOD
        across = np.where(comes, guess, 0.0)
        strikes = free & comes & (steps * PERIOD <= skill.lag + duration / 2.0 + self._early[strike])
        waits = free & ~strikes & (time >= self._next_look)
        along = np.where(strikes, line + skill.through, line - skill.behind)
        goal = np.clip(np.stack([along, across], axis=-1), WORKSPACE_LOW, WORKSPACE_HIGH)
        way = goal - self.intention.end
        distance = np.linalg.norm(way, axis=-1)
        lasts = np.where(strikes, duration, self.person.stroke_duration(distance))
        goes = strikes | (waits & (distance > skill.tolerance))
        self.intention.begin(goes, np.full(len(goes), time), lasts, way, self._bow[:, self.step])
        self._next_look = np.where(waits, time + self._look[:, self.step], self._next_look)
        self._busy = np.where(strikes, time + duration + skill.recover, self._busy)
        self._strikes = np.minimum(self._strikes + strikes, self._line.shape[1] - 1)
