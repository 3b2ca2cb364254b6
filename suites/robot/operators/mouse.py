"""The arm on a mouse: every step it is sent to where the mouse is, through the robot's own clip."""

from __future__ import annotations

from lfobench.contract.episodes import FloatArray
from suites.robot.operators.draws import Draws
from suites.robot.operators.hand import Hand, Person
from suites.robot.operators.journeys import PERIOD, Journey
from suites.robot.operators.recording import Recording, Take
from suites.robot.servo import clipped_action
from suites.robot.simulation import Simulation


def drag(simulation: Simulation, first: FloatArray, person: Person, way: Journey, draws: Draws, limit: int) -> Take:
    """Record a journey that was decided before it began.

    Args:
        simulation: just reset, with rules that end nothing.
        first: ``[n, obs]`` its first observations.
        person: whose hand is on the mouse.
        way: what that person means to do.
        draws: the tremor's.
        limit: steps after which a recording is cut at the latest.
    """
    lengths = way.steps(limit)
    hand = Hand(person, simulation.effector, draws, limit, PERIOD)
    recording = Recording(first)
    for step in range(int(lengths.max())):
        mouse = hand.follow(way.intention.at((step + 1) * PERIOD))
        action = clipped_action(mouse - simulation.effector)
        result = simulation.step(action)
        recording.add(action, result.observation, result.outcome)
    return recording.stopped(lengths)
