"""The overhead camera: bias, noise, latency and dropouts, each against what its constant says."""

from __future__ import annotations

import numpy as np
import pytest

from suites.robot import constants
from suites.robot.servo import SUBSTEPS
from suites.robot.simulation import Camera, Simulation, pictured
from suites.robot.tasks import DynamicHitting, PuckStriking, SafeManipulation

WORLDS, READINGS = 300, 100


def readings(seeds: range = range(WORLDS), count: int = READINGS) -> np.ndarray:
    eye = Camera(seeds, count)
    return np.stack([eye.read(np.zeros((len(seeds), 2))) for _ in range(count)])


def test_bias_is_an_episodes_own_and_noise_a_readings() -> None:
    seen = readings()
    bias = seen.mean(axis=0)
    assert np.std(bias) == pytest.approx(float(constants.CAMERA_BIAS), rel=0.1)
    assert abs(bias.mean()) < 0.0006
    assert np.std(seen - bias) == pytest.approx(float(constants.CAMERA_NOISE), rel=0.03)
    # Noise forgets itself from one reading to the next, but for the held ones.
    centred = (seen - bias) / np.std(seen - bias)
    assert np.mean(centred[1:] * centred[:-1]) == pytest.approx(float(constants.CAMERA_DROPOUT), abs=0.02)


def test_a_dropout_holds_the_last_reading() -> None:
    seen = readings()
    held = (seen[1:] == seen[:-1]).all(axis=2)
    assert held.mean() == pytest.approx(float(constants.CAMERA_DROPOUT), rel=0.1)


def test_the_first_reading_is_never_lost() -> None:
    seeds = range(2000)
    assert (Camera(seeds, 1).read(np.ones((len(seeds), 2))) != 0.0).all()


def test_a_longer_episode_sees_the_same_at_first() -> None:
    np.testing.assert_array_equal(readings(range(5), 20), readings(range(5), 100)[:20])


def test_the_picture_is_one_frame_old() -> None:
    time = np.arange(1, SUBSTEPS + 1) / float(constants.PHYSICS_RATE)
    path = np.stack([time, -time], axis=1)[None]
    end = 1 / float(constants.CONTROL_RATE) - 1 / float(constants.CAMERA_RATE)
    np.testing.assert_allclose(pictured(path), [[end, -end]])


def test_a_moving_puck_is_seen_where_it_was() -> None:
    simulation = Simulation(DynamicHitting(), WORLDS, 10, ends=False)
    across = np.full((WORLDS, 2), (0.0, 1.2))
    simulation.reset(range(WORLDS), puck=np.full((WORLDS, 2), (1.5, -0.3)), puck_velocity=across)
    for _ in range(4):
        stepped = simulation.step(np.zeros((WORLDS, 2)))
    assert simulation.puck is not None
    seen = stepped.observation[:, 4:6] + simulation.effector
    assert (seen - simulation.puck).mean(axis=0)[1] == pytest.approx(-1.2 / 60, abs=0.002)


def test_only_the_hand_is_known_by_the_camera() -> None:
    robot, hand = Simulation(SafeManipulation("robot"), 1), Simulation(SafeManipulation("hand"), 1)
    exact, seen = robot.reset([5]), hand.reset([5])
    np.testing.assert_array_equal(robot.effector, hand.effector)
    np.testing.assert_array_equal(exact, robot.effector.astype(np.float32))
    assert 0.0 < np.abs(seen - exact).max() < 0.03


def test_a_striking_robot_knows_itself_exactly_and_the_puck_by_the_camera() -> None:
    simulation = Simulation(PuckStriking(), 1)
    observation = simulation.reset([5])
    assert simulation.puck is not None
    np.testing.assert_array_equal(observation[:, :2], simulation.effector.astype(np.float32))
    assert 0.0 < np.abs(observation[:, 2:] - simulation.puck).max() < 0.03


def test_the_hitting_robot_remembers_five_relative_positions_newest_first() -> None:
    simulation = Simulation(DynamicHitting(), 3, 50, ends=False)
    before = simulation.reset([1, 2, 3])
    np.testing.assert_array_equal(before[:, 4:], np.tile(before[:, 4:6], 5))
    for _ in range(7):
        after = simulation.step(np.full((3, 2), 0.1)).observation
        np.testing.assert_array_equal(after[:, 6:], before[:, 4:-2])
        np.testing.assert_array_equal(after[:, :2], simulation.effector.astype(np.float32))
        np.testing.assert_array_equal(after[:, 2:4], simulation.effector_velocity.astype(np.float32))
        before = after
