"""Parts of the scripted demonstrators: strokes, hands, routes, predictions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from suites.robot import constants, tasks
from suites.robot.demonstrators.human_motion import MOUSE, PERIOD, Draws, Hand, Intention, bulge, minimum_jerk
from suites.robot.demonstrators.planning import (
    BENDS,
    DelayedView,
    Routes,
    crossing,
    first_clear,
    mirrored,
    sliding_path,
)
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW
from suites.robot.simulation import Simulation


def test_a_stroke_is_bell_shaped() -> None:
    phase = np.linspace(0.0, 1.0, 1001)
    speed = np.gradient(minimum_jerk(phase), phase)
    np.testing.assert_allclose(minimum_jerk(phase)[[0, 500, -1]], [0.0, 0.5, 1.0])
    assert abs(speed.max() - 1.875) < 1e-3 and abs(speed.argmax() - 500) <= 1
    assert speed[[0, -1]].max() < 0.01
    np.testing.assert_allclose(bulge(phase)[[0, 500, -1]], [0.0, 1.0, 0.0], atol=1e-12)


def test_strokes_add_up_and_a_full_hand_forgets_none() -> None:
    intention, everyone, zero = Intention(np.zeros((2, 2)), 3), np.ones(2, np.bool_), np.zeros(2)
    for stroke in range(5):
        intention.begin(everyone, np.full(2, float(stroke)), np.ones(2), np.array([[0.1, 0.0], [0.0, 0.2]]), zero)
    np.testing.assert_allclose(intention.end, [[0.5, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(intention.at(4.5), [[0.45, 0.0], [0.0, 0.9]])
    np.testing.assert_allclose(intention.during(np.array([4.5, 9.0]))[:, 1], intention.end)


def test_a_hand_lags_swings_past_and_settles() -> None:
    draws = Draws(np.random.default_rng(0), 50)
    hand = Hand(MOUSE, np.zeros((50, 2)), draws, 60, PERIOD)
    path = np.stack([hand.follow(np.tile([0.3, 0.0], (50, 1))) for _ in range(60)])
    middle = path.mean(1)
    assert middle[0, 0] < 0.1
    assert 0.305 < middle[:, 0].max() < 0.33
    assert np.abs(middle[-10:] - [0.3, 0.0]).max() < 0.002
    trembling = path[-20:].std(0)
    assert 0.5 * MOUSE.tremor < trembling.mean() < 1.2 * MOUSE.tremor


@settings(max_examples=25, deadline=None)
@given(x=st.floats(0.25, 0.95), y=st.floats(-0.3, 0.3))
def test_a_route_reaches_the_bowl_and_keeps_its_distance(x: float, y: float) -> None:
    distance = tasks.CUP_REACH + 0.03
    routes = Routes(tasks.CUPS, distance, tasks.BOWL, WORKSPACE_LOW, WORKSPACE_HIGH)
    start = np.array([[x, y]])
    bends = routes.plan(start, np.zeros((1, len(routes.points))), np.zeros(1))
    assert bends.shape == (1, BENDS, 2)
    np.testing.assert_array_equal(bends[0, -1], tasks.BOWL)
    corners = np.concatenate([start, bends[0]])
    along = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(corners)])
    from_cups = np.linalg.norm(along[:, None] - tasks.CUPS, axis=-1).min(0)
    allowed = np.minimum(distance, np.linalg.norm(start - tasks.CUPS, axis=-1))
    assert (from_cups >= allowed - 1e-6).all()


def test_foresight_agrees_with_the_simulated_puck() -> None:
    n = 40
    simulation = Simulation(tasks.DynamicHitting("hit"), n, 100, ends=False)
    simulation.reset(range(n), effector=np.tile([0.3, 0.0], (n, 1)))
    puck, velocity = simulation.puck, simulation.puck_velocity
    assert puck is not None and velocity is not None
    path = sliding_path(puck, velocity, 20)
    for step in range(20):
        simulation.step(np.zeros((n, 2)))
        truly = simulation.puck
        assert truly is not None
        assert np.linalg.norm(path[:, step] - truly, axis=-1).max() < 0.02


def test_eyes_see_late_and_make_up_for_it() -> None:
    position, velocity = np.array([[1.5, 0.0], [1.5, 0.0]]), np.array([[-0.2, 0.1], [-0.2, 0.1]])
    truth = sliding_path(position, velocity, 12)
    view = DelayedView(np.array([0, 3]))
    view.add(position, velocity)
    fall = 9.81 * np.sin(np.radians(constants.TABLE_TILT)) * (1.0 - constants.FRICTION_LOSS)
    for step in range(3):
        view.add(truth[:, step], velocity - [fall * PERIOD * (step + 1), 0.0])
    np.testing.assert_allclose(view.predict(8), truth[:, 3:11], atol=1e-9)


def test_a_crossing_is_where_the_path_comes_down_over_the_line() -> None:
    path = np.array([[[1.0, 0.0], [0.8, 0.1], [0.6, 0.2]], [[1.0, 0.0], [1.1, 0.0], [1.2, 0.0]]])
    steps, place = crossing(path, np.array([0.7, 0.7]))
    assert steps.tolist() == [3, 4]
    assert abs(place[0] - 0.15) < 1e-12


def test_places_are_mirrored_into_the_workspace_and_the_first_that_suits_is_taken() -> None:
    beyond = np.array([WORKSPACE_HIGH + 0.1, WORKSPACE_LOW - 0.1, (WORKSPACE_LOW + WORKSPACE_HIGH) / 2])
    np.testing.assert_allclose(mirrored(beyond), [WORKSPACE_HIGH - 0.1, WORKSPACE_LOW + 0.1, beyond[2]])
    clearance = np.array([[0.1, 0.3, 0.4], [0.1, 0.2, 0.15]])
    assert first_clear(clearance, np.array([0.25, 0.25])).tolist() == [1, 1]
