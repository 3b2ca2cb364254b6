"""The arm's servo: first-order response, velocity limit, workspace, and the emergency stop."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from suites.robot import constants, servo
from suites.robot.servo import SUBSTEP, SUBSTEPS, WORKSPACE_HIGH, WORKSPACE_LOW
from suites.robot.simulation import Simulation
from suites.robot.tasks import PuckStriking, SafeManipulation

TAU, LIMIT = 0.1, 1.0


def test_a_small_step_is_followed_to_first_order() -> None:
    """``1 - exp(-t / tau)`` of the way at every substep, along the straight line."""
    effector, goal = np.array([[0.4, 0.0]]), np.array([[0.41, -0.01]])
    path = effector[:, None] + np.cumsum(servo.velocity_profile(effector, goal), axis=1) * SUBSTEP
    time = SUBSTEP * np.arange(1, SUBSTEPS + 1)
    expected = effector[:, None] + (1.0 - np.exp(-time / TAU))[None, :, None] * (goal - effector)[:, None]
    np.testing.assert_allclose(path, expected, atol=1e-12)


def test_the_simulated_arm_follows_it() -> None:
    """A command that is held, in the physics: a small displacement asks for less than the force limit."""
    simulation = Simulation(SafeManipulation(), 1, 50)
    simulation.reset([0], effector=np.array([[0.4, -0.2]]))
    goal = np.array([[0.41, -0.205]])
    for step in range(1, 11):
        simulation.step(servo.clipped_action(goal - simulation.effector))
        share = 1.0 - math.exp(-step / 20 / TAU)
        np.testing.assert_allclose(simulation.effector, [[0.4 + 0.01 * share, -0.2 - 0.005 * share]], atol=2e-5)


def test_a_far_target_is_approached_at_the_velocity_limit_and_then_to_first_order() -> None:
    distance = np.array([1.0, 0.15, 0.02])
    remaining = servo.remaining_distance(distance)
    time = SUBSTEP * np.arange(SUBSTEPS + 1)
    np.testing.assert_allclose(remaining[0], 1.0 - LIMIT * time, atol=1e-12)
    np.testing.assert_allclose(remaining[2], 0.02 * np.exp(-time / TAU), atol=1e-12)
    # The law in continuous time changes over inside a substep.
    switch = 0.15 / LIMIT - TAU
    law = np.where(time < switch, 0.15 - LIMIT * time, LIMIT * TAU * np.exp(-(time - switch) / TAU))
    np.testing.assert_allclose(remaining[1], law, atol=LIMIT * SUBSTEP / 10)


coordinates = st.tuples(st.floats(0.25, 0.95), st.floats(-0.3, 0.3))
actions = st.tuples(st.floats(-1, 1), st.floats(-1, 1))


@settings(max_examples=100, deadline=None)
@given(position=coordinates, action=actions)
def test_the_reference_keeps_to_the_limits(position: tuple[float, float], action: tuple[float, float]) -> None:
    effector, wanted = np.array([position]), np.array([action])
    goal = servo.target(effector, wanted)
    assert (goal >= WORKSPACE_LOW).all() and (goal <= WORKSPACE_HIGH).all()
    profile = servo.velocity_profile(effector, goal)
    assert np.linalg.norm(profile, axis=2).max() <= LIMIT * (1 + 1e-9)
    end = effector + profile.sum(axis=1) * SUBSTEP
    assert np.linalg.norm(goal - end) <= np.linalg.norm(goal - effector) + 1e-12


def test_random_commands_leave_the_arm_inside_its_workspace_and_limit() -> None:
    generator = np.random.default_rng(3)
    simulation = Simulation(SafeManipulation(), 16, 200, ends=False)
    simulation.reset(range(16))
    for _ in range(200):
        simulation.step(generator.uniform(-1, 1, (16, 2)))
        assert (simulation.effector >= WORKSPACE_LOW - 1e-9).all()
        assert (simulation.effector <= WORKSPACE_HIGH + 1e-9).all()
        assert np.linalg.norm(simulation.effector_velocity, axis=1).max() <= LIMIT * math.sqrt(2) + 1e-9


def test_the_robots_clip() -> None:
    np.testing.assert_allclose(servo.clipped_action(np.array([[0.13, -0.5], [-0.26, 0.065]])), [[0.5, -1], [-1, 0.5]])


def outcomes_of(commands: list[tuple[float, float]]) -> list[str | None]:
    simulation = Simulation(SafeManipulation(), 1, 50)
    simulation.reset([0], effector=np.array([[0.35, -0.28]]))
    return [simulation.step(np.array([command])).outcome[0] for command in commands]


def test_reversing_at_full_speed_is_an_emergency_stop() -> None:
    assert outcomes_of([(1, 0)] * 4 + [(-1, 0)])[-1] == "emergency stop"


def test_starting_and_stopping_at_full_speed_is_none() -> None:
    assert set(outcomes_of([(1, 0)] * 5 + [(0, 0)] * 3)) == {None}


def test_squeezing_the_puck_against_the_rail_is_an_emergency_stop() -> None:
    simulation = Simulation(PuckStriking(), 1, 50, ends=False)
    simulation.reset([0], effector=np.array([[0.7, 0.2]]), puck=np.array([[0.7, 0.34]]))
    told = [simulation.step(np.array([[0.0, 1.0]])).outcome[0] for _ in range(10)]
    assert "emergency stop" in told
    assert simulation.puck is not None
    # The arm is stopped by the puck, and the puck by the rail.
    side, radius = float(constants.TABLE_WIDTH) / 2, float(constants.PUCK_DIAMETER) / 2
    assert simulation.puck[0, 1] == pytest.approx(side - radius, abs=0.005)


def test_the_force_is_limited() -> None:
    """From rest, the arm gains no more speed than its force gives its mass."""
    simulation = Simulation(SafeManipulation(), 1, 50)
    simulation.reset([0], effector=np.array([[0.35, -0.28]]))
    profile = servo.velocity_profile(simulation.effector, np.array([[0.61, -0.28]]))
    assert profile[0, 0, 0] == pytest.approx(LIMIT)
    simulation.step(np.array([[1.0, 0.0]]))
    lag = profile.sum(axis=1)[0, 0] * SUBSTEP - (simulation.effector[0, 0] - 0.35)
    assert lag == pytest.approx(LIMIT**2 / (2 * 50.0), rel=0.3)
