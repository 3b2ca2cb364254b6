"""Moving about a sliding puck without striking it: the suboptimal operator of dynamic hitting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from suites.robot import tasks
from suites.robot.operators.draws import Draws
from suites.robot.operators.hand import QUICK_HAND, Person, minimum_jerk
from suites.robot.operators.journeys import PERIOD
from suites.robot.operators.places import around, choose, folded
from suites.robot.operators.reacting import Reacting
from suites.robot.operators.recording import Recording, Take, scored
from suites.robot.operators.scripted import Scripted
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW
from suites.robot.simulation import Simulation
from suites.robot.tasks import DynamicHitting


@dataclass(frozen=True)
class Dodging(Scripted):
    """Somebody who moves about the puck and keeps out of its way; lengths in metres, times in seconds, all ours.

    Attributes:
        person: how the hand moves.
        seconds: shortest and longest recording.
        delay: shortest and longest time by which what is seen is late.
        horizon: how far ahead the puck is foreseen.
        lag: how late hand and arm are known to be.
        stay: shortest and longest time between two movements.
        start: least time between two movements, when the puck comes too near.
        around: least and greatest distance from the puck at which a place is looked for.
        free: what is left free between paddle and puck.
        haste: smallest and largest factor on a stroke's duration.
        careless: probability that a movement is made, and carried through, without a thought of the puck.
        thoughts: places that are weighed before every other movement.
        score: what counts as a success of somebody who does not try.
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
        """That many episodes."""
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
    """n people who each keep out of a puck's way.

    Args:
        manner: how.
        simulation: just reset.
        draws: every movement's.
        steps: most control steps.
    """

    def __init__(self, manner: Dodging, simulation: Simulation, draws: Draws, steps: int) -> None:
        n, most = draws.episodes, int(steps * PERIOD / manner.start) + 2
        super().__init__(manner.person, manner.delay, simulation, draws, steps)
        self._manner = manner
        self._stay, self._haste = draws.uniform(*manner.stay, most), draws.uniform(*manner.haste, most)
        self._careless, self._bow = draws.happens(manner.careless, most), draws.normal(manner.person.bow, most)
        self._away = around(draws, *manner.around, most, manner.thoughts)
        self._began, self._next = np.zeros(n), draws.uniform(0.0, 0.5)
        self._moves, self._heedless = np.zeros(n, np.int64), np.zeros(n, np.bool_)

    def decide(self, time: float) -> None:
        """Move when it is time to, or when the puck comes too near."""
        manner = self._manner
        steps = round(manner.horizon / PERIOD)
        puck = self.eyes.foresee(steps)
        later = time - manner.lag + PERIOD * np.arange(1, steps + 1)
        arm = self.intention.during(later)
        near = np.linalg.norm(arm - puck, axis=-1).min(-1) < tasks.PUCK_REACH + manner.free
        moves = (time >= self._next) | (near & ~self._heedless & (time >= self._began + manner.start))
        who = np.flatnonzero(moves)
        if not len(who):
            return
        move = (who, self._moves[who])
        places = folded(np.clip(puck[who, steps // 2, None], WORKSPACE_LOW, WORKSPACE_HIGH) + self._away[move])
        ways = places - self.intention.end[who, None]
        lasts = self._haste[move][:, None] * manner.person.stroke_duration(np.linalg.norm(ways, axis=-1))
        progress = minimum_jerk((later - time) / lasts[..., None])
        paths = arm[who, None] + progress[..., None] * ways[:, :, None]
        clear = np.linalg.norm(paths - puck[who, None], axis=-1).min(-1)
        wanted = np.where(self._careless[move], 0.0, tasks.PUCK_REACH + manner.free)
        rows, chosen = np.arange(len(who)), choose(clear, wanted)
        way, duration, bow = np.zeros((len(moves), 2)), np.ones(len(moves)), np.zeros(len(moves))
        way[who], duration[who], bow[who] = ways[rows, chosen], lasts[rows, chosen], self._bow[move]
        self.intention.begin(moves, np.full(len(moves), time), duration, way, bow)
        self._began[who], self._next[who] = time, time + self._stay[move]
        self._heedless[who] = self._careless[move]
        self._moves[who] += 1
