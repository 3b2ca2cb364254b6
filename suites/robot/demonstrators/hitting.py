"""Hitting a sliding puck: an expert who predicts where it comes and strikes it back, and a suboptimal dodger."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from suites.robot import tasks
from suites.robot.demonstrators.human_motion import (
    PERIOD,
    QUICK_HAND,
    Array,
    Draws,
    Hand,
    Intention,
    Person,
    minimum_jerk,
)
from suites.robot.demonstrators.planning import DelayedView, crossing, displacements, first_clear, mirrored
from suites.robot.demonstrators.recording import Recording, ScriptedDemonstrator, Take, scored
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW, clipped_action
from suites.robot.simulation import Simulation
from suites.robot.tasks import DynamicHitting

STROKES_AT_ONCE = 12
"""Upper bound of strokes that overlap."""


class Reacting(ABC):
    """Demonstrators who react to the puck, one per world.

    Args:
        person: model of the hands.
        delay: shortest and longest reaction time in seconds.
        simulation: just reset.
        draws: everything random.
        steps: most control steps.
    """

    def __init__(
        self, person: Person, delay: tuple[float, float], simulation: Simulation, draws: Draws, steps: int
    ) -> None:
        self.person, self.simulation = person, simulation
        self.intention = Intention(simulation.effector, STROKES_AT_ONCE)
        self.view = DelayedView(np.rint(draws.uniform(*delay) / PERIOD).astype(np.int64))
        self.step = 0
        self._hand = Hand(person, simulation.effector, draws, steps, PERIOD)

    @abstractmethod
    def decide(self, time: float) -> None:
        """Begin strokes after the newest look at the puck; `time` in seconds since the start."""

    def act(self) -> Array:
        """The next action ``[n, 2]``."""
        puck, velocity = self.simulation.puck, self.simulation.puck_velocity
        assert puck is not None and velocity is not None
        self.view.add(puck, velocity)
        self.decide(self.step * PERIOD)
        self.step += 1
        mouse = self._hand.follow(self.intention.at(self.step * PERIOD))
        return clipped_action(mouse - self.simulation.effector)


SINGLE_LIMIT = DynamicHitting.horizon
"""Steps after which a recording of one hit is cut at the latest."""
REPEATED_LIMIT = 2000
"""Steps after which a recording of repeated hits is cut."""
SHORTEST_RALLY = 16
"""Steps between two strikes at the least."""


@dataclass(frozen=True)
class Skill:
    """Parameters of the expert's play; lengths in metres, times in seconds, every number ours.

    Attributes:
        delay: shortest and longest reaction time.
        horizon: of the prediction of the puck.
        line: least and greatest x of the preferred contact.
        behind: distance behind that line at which the paddle waits.
        through: distance beyond it to which the strike goes.
        strike: shortest and longest duration of a strike.
        lag: of hand and arm, which is anticipated.
        timing: standard deviation of the strike's onset.
        doubt: standard deviation of the predicted place across the table, per second until then.
        aim: standard deviation of the strike's end across the table.
        look: shortest and longest time between two corrections while waiting.
        tolerance: error that is not corrected.
        lapse: probability of a misjudged strike.
        missing: error of a misjudged strike across the table.
        recover: time after the strike's end before the paddle goes back.
        linger: shortest and longest time between the last event and the recording's end.
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
class Hitting(ScriptedDemonstrator):
    """An expert, who hits the puck once or repeatedly.

    Attributes:
        single: number of first episodes that end after one hit, None for all; the later ones go on until the puck is
            lost or 2000 steps are made.
        person: model of the hand.
        skill: parameters of its play.
        score: what counts as a success; the play is the same.
    """

    single: int | None = None
    person: Person = QUICK_HAND
    skill: Skill = SKILL
    score: Literal["touch", "hit"] = "hit"

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings, each of which stops by the rules of a hit."""
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
    """n experts, each with a puck and a mouse.

    Args:
        person: model of the hands.
        skill: parameters of their play.
        simulation: just reset.
        draws: everything random.
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
        """``[n]`` whether the puck is out of reach for good."""
        puck = self.simulation.puck
        assert puck is not None
        return puck[:, 0] < tasks.LOST_X

    def decide(self, time: float) -> None:
        """Strike when the puck is about to come, else wait behind the line at its predicted place."""
        skill, strike = self._skill, (self._rows, self._strikes)
        ahead = round(skill.horizon / PERIOD)
        line, duration = self._line[strike], self._duration[strike]
        steps, place = crossing(self.view.predict(ahead), line)
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


@dataclass(frozen=True)
class Dodging(ScriptedDemonstrator):
    """A suboptimal demonstrator, who avoids the puck; lengths in metres, times in seconds, all ours.

    Attributes:
        person: model of the hand.
        seconds: shortest and longest recording.
        delay: shortest and longest reaction time.
        horizon: of the prediction of the puck.
        lag: of hand and arm, which is anticipated.
        stay: shortest and longest time between two movements.
        start: least time between two movements when the puck comes too near.
        around: least and greatest distance from the puck of the places that are considered.
        free: distance kept between paddle and puck.
        haste: smallest and largest factor on a stroke's duration.
        careless: probability that a movement ignores the puck.
        thoughts: candidate places of every other movement.
        score: what counts as a success.
    """

    person: Person = QUICK_HAND
    seconds: tuple[float, float] = (9.0, 11.0)
    delay: tuple[float, float] = (0.15, 0.22)
    horizon: float = 0.9
    lag: float = 0.2
    stay: tuple[float, float] = (0.4, 1.3)
    start: float = 0.15
    around: tuple[float, float] = (0.12, 0.4)
    free: float = 0.02
    haste: tuple[float, float] = (1.0, 2.6)
    careless: float = 0.2
    thoughts: int = 12
    score: Literal["touch", "hit"] = "hit"

    def perform(self, episodes: int, generator: np.random.Generator) -> Take:
        """Recordings of `episodes` episodes."""
        draws = Draws(generator, episodes)
        lengths = np.rint(draws.uniform(*self.seconds) / PERIOD).astype(np.int64)
        limit = int(lengths.max())
        simulation = Simulation(DynamicHitting("hit"), episodes, limit + 1, ends=False)
        recording = Recording(simulation.reset(draws.seeds.tolist()))
        mover = Mover(self, simulation, draws, round(self.seconds[1] / PERIOD))
        for _ in range(limit):
            action = mover.act()
            result = simulation.step(action)
            recording.add(action, result.observation, scored(result.outcome, simulation.touched, self.score))
        return recording.stopped(lengths)


class Mover(Reacting):
    """n suboptimal demonstrators, each with a puck to avoid.

    Args:
        manner: their parameters.
        simulation: just reset.
        draws: everything random.
        steps: most control steps.
    """

    def __init__(self, manner: Dodging, simulation: Simulation, draws: Draws, steps: int) -> None:
        n, most = draws.episodes, int(steps * PERIOD / manner.start) + 2
        super().__init__(manner.person, manner.delay, simulation, draws, steps)
        self._manner = manner
        self._stay, self._haste = draws.uniform(*manner.stay, most), draws.uniform(*manner.haste, most)
        self._careless, self._bow = draws.happens(manner.careless, most), draws.normal(manner.person.bow, most)
        self._away = displacements(draws, *manner.around, most, manner.thoughts)
        self._began, self._next = np.zeros(n), draws.uniform(0.0, 0.5)
        self._moves, self._heedless = np.zeros(n, np.int64), np.zeros(n, np.bool_)

    def decide(self, time: float) -> None:
        """Move when the stay is over, or when the puck comes too near."""
        manner = self._manner
        steps = round(manner.horizon / PERIOD)
        puck = self.view.predict(steps)
        later = time - manner.lag + PERIOD * np.arange(1, steps + 1)
        arm = self.intention.during(later)
        near = np.linalg.norm(arm - puck, axis=-1).min(-1) < tasks.PUCK_REACH + manner.free
        moves = (time >= self._next) | (near & ~self._heedless & (time >= self._began + manner.start))
        who = np.flatnonzero(moves)
        if not len(who):
            return
        move = (who, self._moves[who])
        places = mirrored(np.clip(puck[who, steps // 2, None], WORKSPACE_LOW, WORKSPACE_HIGH) + self._away[move])
        ways = places - self.intention.end[who, None]
        lasts = self._haste[move][:, None] * manner.person.stroke_duration(np.linalg.norm(ways, axis=-1))
        progress = minimum_jerk((later - time) / lasts[..., None])
        paths = arm[who, None] + progress[..., None] * ways[:, :, None]
        clear = np.linalg.norm(paths - puck[who, None], axis=-1).min(-1)
        wanted = np.where(self._careless[move], 0.0, tasks.PUCK_REACH + manner.free)
        rows, chosen = np.arange(len(who)), first_clear(clear, wanted)
        way, duration, bow = np.zeros((len(moves), 2)), np.ones(len(moves)), np.zeros(len(moves))
        way[who], duration[who], bow[who] = ways[rows, chosen], lasts[rows, chosen], self._bow[move]
        self.intention.begin(moves, np.full(len(moves), time), duration, way, bow)
        self._began[who], self._next[who] = time, time + self._stay[move]
        self._heedless[who] = self._careless[move]
        self._moves[who] += 1
