"""The simulation: its rules, every outcome, determinism, and worlds that do not know of each other."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from suites.robot import constants, servo
from suites.robot.simulation import Simulation, StepResult
from suites.robot.tasks import (
    BOWL,
    CUP_REACH,
    CUPS,
    LOST_X,
    DynamicHitting,
    PuckStriking,
    RobotTask,
    SafeManipulation,
)

Array = NDArray[np.float64]

ALL: list[RobotTask] = [
    SafeManipulation("robot"),
    SafeManipulation("hand"),
    PuckStriking(),
    DynamicHitting("touch"),
    DynamicHitting("hit"),
]


def pair(x: float, y: float) -> Array:
    return np.array([[x, y]])


def towards(simulation: Simulation, goal: Array, speed: float = 1.0) -> Array:
    """Straight at the goal: short enough for the clip, which would bend a longer command."""
    way = goal - simulation.effector
    return servo.clipped_action(way / max(1.0, float(np.linalg.norm(way)) / 0.1)) * speed


def run(simulation: Simulation, goal: Array | None) -> tuple[StepResult, int]:
    """Step a single world to its end, towards a fixed goal or with no displacement at all."""
    for step in range(1, simulation.horizon + 1):
        action = np.zeros((1, 2)) if goal is None else towards(simulation, goal)
        stepped = simulation.step(action)
        if stepped.terminated[0] or stepped.truncated[0]:
            return stepped, step
    raise AssertionError("the horizon did not end the episode")


def ended(simulation: Simulation, goal: Array | None = None) -> str | None:
    """The outcome, once it is consistent with reward and flags."""
    stepped, step = run(simulation, goal)
    assert stepped.ended[0]
    assert stepped.reward[0] == (1.0 if stepped.outcome[0] == "success" else 0.0)
    assert stepped.truncated[0] == (not stepped.terminated[0])
    assert stepped.truncated[0] == (stepped.outcome[0] == "out of time") or step == simulation.horizon
    return stepped.outcome[0]


class TestSafeManipulation:
    def started(self, x: float, y: float, horizon: int | None = None) -> Simulation:
        simulation = Simulation(SafeManipulation(), 1, horizon)
        simulation.reset([0], effector=pair(x, y))
        return simulation

    def test_rest_above_the_bowl_succeeds(self) -> None:
        assert ended(self.started(0.9, 0.1), BOWL[None]) == "success"

    def test_success_asks_for_rest_and_not_for_a_visit(self) -> None:
        simulation = self.started(0.84, 0.29)
        goals = np.array([[0.84, 0.12], [0.84, 0.28]])
        for step in range(60):
            stepped = simulation.step(towards(simulation, goals[step // 5 % 2][None]))
            assert not stepped.terminated[0]

    def test_the_rest_lasts_as_long_as_said(self) -> None:
        _, steps = run(self.started(*BOWL), None)
        assert steps == constants.GOAL_REST_TIME * constants.CONTROL_RATE

    def test_trembling_on_the_spot_is_rest(self) -> None:
        simulation = self.started(*BOWL)
        for step in range(20):
            stepped = simulation.step(pair(0.02 * (-1) ** step, 0.0))
            if stepped.terminated[0]:
                break
        assert stepped.outcome[0] == "success"

    def test_a_straight_way_through_a_cup_hits_it(self) -> None:
        simulation = self.started(float(constants.CORNER_X), float(constants.CORNER_Y))
        assert ended(simulation, BOWL[None]) == "cup hit"
        assert np.linalg.norm(CUPS - simulation.effector, axis=1).min() < CUP_REACH + 0.05

    def test_rest_elsewhere_stalls(self) -> None:
        _, steps = run(self.started(0.4, -0.2), None)
        assert steps == constants.STALL_TIME * constants.CONTROL_RATE
        assert ended(self.started(0.4, -0.2)) == "stalled"

    def test_time_runs_out(self) -> None:
        assert ended(self.started(0.4, -0.2, horizon=12)) == "out of time"


class TestPuckStriking:
    def started(self, horizon: int | None = None) -> Simulation:
        simulation = Simulation(PuckStriking(), 1, horizon)
        simulation.reset([4])
        return simulation

    def test_the_start_pose(self) -> None:
        np.testing.assert_array_equal(self.started().effector, pair(0.38, 0.0))

    def test_a_touch_succeeds(self) -> None:
        simulation = self.started()
        assert ended(simulation, simulation.puck) == "success"

    def test_rest_stalls_and_the_puck_lies_still(self) -> None:
        simulation = self.started()
        puck = simulation.puck
        assert ended(simulation) == "stalled"
        np.testing.assert_array_equal(simulation.puck, puck)

    def test_time_runs_out(self) -> None:
        assert ended(self.started(horizon=12)) == "out of time"


class TestDynamicHitting:
    def started(self, score: str, puck: Array, velocity: Array) -> Simulation:
        simulation = Simulation(DynamicHitting(score), 1)  # type: ignore[arg-type]
        simulation.reset([0], puck=puck, puck_velocity=velocity)
        return simulation

    def test_the_start(self) -> None:
        simulation = Simulation(DynamicHitting(), 50)
        simulation.reset(range(50))
        assert simulation.puck is not None and simulation.puck_velocity is not None
        np.testing.assert_array_equal(simulation.effector, np.tile([0.68, 0.0], (50, 1)))
        assert (simulation.puck[:, 0] == constants.RELEASE_X).all() and np.ptp(simulation.puck[:, 1]) > 0.4
        assert (simulation.puck_velocity[:, 0] <= 0).all() and np.ptp(simulation.puck_velocity[:, 1]) > 0.5

    @pytest.mark.parametrize("score", ["touch", "hit"])
    def test_a_puck_that_passes_is_missed(self, score: str) -> None:
        simulation = self.started(score, pair(0.9, 0.2), pair(-0.5, 0.0))
        assert ended(simulation) == "missed"
        assert simulation.puck is not None
        assert LOST_X - 0.1 < simulation.puck[0, 0] < LOST_X

    @pytest.mark.parametrize("score", ["touch", "hit"])
    def test_a_puck_that_is_sent_back_succeeds(self, score: str) -> None:
        simulation = self.started(score, pair(1.0, 0.0), pair(-0.8, 0.0))
        assert ended(simulation, pair(0.9, 0.0)) == "success"

    def test_a_grazed_puck_is_touched_and_not_hit(self) -> None:
        graze = pair(0.85, 0.074), pair(-0.6, 0.0)
        assert ended(self.started("touch", *graze)) == "success"
        assert ended(self.started("hit", *graze)) == "touched only"

    def test_a_puck_that_is_held_until_the_end_is_touched_only(self) -> None:
        simulation = self.started("hit", pair(0.76, 0.0), pair(0.0, 0.0))
        for step in range(simulation.horizon):
            assert simulation.puck is not None
            # A retreat that softens the contact, then standing below the puck.
            below = pair(0.68 - 0.01 * min(step, 5), simulation.puck[0, 1])
            stepped = simulation.step(towards(simulation, below, 0.2))
            if stepped.ended[0]:
                break
        assert (stepped.outcome[0], bool(stepped.truncated[0])) == ("touched only", True)


def commands(count: int, steps: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (steps, count, 2))


@pytest.mark.parametrize("task", ALL, ids=str)
def test_a_world_gives_the_same_bits_alone_and_among_others(task: RobotTask) -> None:
    """Position in the array, number of worlds and what the others do change nothing; nor does an earlier episode."""
    many, alone = Simulation(task, 7, 70, ends=False), Simulation(task, 1, 70, ends=False)
    first, seeds = commands(7, 60, 1), [3, 9, 4, 1, 1, 2**40, 0]
    many.reset([5] * 7)
    many.step(first[0])
    together = [many.reset(seeds)]
    for action in first:
        stepped = many.step(action)
        together += [stepped.observation, many.effector, stepped.reward]
        together += [] if many.puck is None else [many.puck]
    for world in (0, 3, 6):
        single = [alone.reset([seeds[world]])]
        for action in first:
            stepped = alone.step(action[world : world + 1])
            single += [stepped.observation, alone.effector, stepped.reward]
            single += [] if alone.puck is None else [alone.puck]
        for ours, theirs in zip(single, together, strict=True):
            assert ours[0].tobytes() == theirs[world].tobytes()


@pytest.mark.parametrize("task", ALL, ids=str)
def test_the_seed_decides(task: RobotTask) -> None:
    simulation = Simulation(task, 2, 20)
    action = commands(2, 1, 0)[0]

    def seen(seeds: list[int]) -> Array:
        return np.stack([simulation.reset(seeds), simulation.step(action).observation])

    np.testing.assert_array_equal(seen([1, 2]), seen([1, 2]))
    assert (seen([1, 2])[0] != seen([3, 4])[0]).any(axis=1).all()


def test_a_longer_horizon_changes_nothing_before_it() -> None:
    short, long = Simulation(DynamicHitting(), 3, 20, ends=False), Simulation(DynamicHitting(), 3, 90, ends=False)
    np.testing.assert_array_equal(short.reset([1, 2, 3]), long.reset([1, 2, 3]))
    for action in commands(3, 20, 2):
        np.testing.assert_array_equal(short.step(action).observation, long.step(action).observation)


def test_a_finished_world_reports_once() -> None:
    simulation = Simulation(SafeManipulation(), 2, 60)
    simulation.reset([0, 1], effector=np.array([BOWL, [0.4, -0.2]]))
    told, rewards = [], []
    for _ in range(60):
        stepped = simulation.step(np.zeros((2, 2)))
        told.append(stepped.outcome)
        rewards.append(stepped.reward)
    assert [outcome for outcome, _ in told if outcome] == ["success"]
    assert [outcome for _, outcome in told if outcome] == ["stalled"]
    assert np.sum(rewards, axis=0).tolist() == [1.0, 0.0]
    assert stepped.terminated.all() and not stepped.truncated.any()


def test_recording_goes_on_and_tells_what_the_rules_would_have_said() -> None:
    simulation = Simulation(SafeManipulation(), 1, 60, ends=False)
    simulation.reset([0], effector=pair(0.4, -0.2))
    told = []
    for _ in range(60):
        stepped = simulation.step(np.zeros((1, 2)))
        told.append(stepped.outcome[0])
        assert not stepped.terminated[0]
    assert stepped.truncated[0]
    assert told == [None] * 39 + ["stalled"] * 21


def test_returned_arrays_are_the_callers() -> None:
    simulation = Simulation(DynamicHitting(), 2, 20)
    kept = [simulation.reset([1, 2]), simulation.effector, simulation.puck]
    stepped = simulation.step(np.zeros((2, 2)))
    kept += [stepped.observation, stepped.terminated, stepped.outcome]
    copies = [np.array(array) for array in kept]
    simulation.step(np.full((2, 2), 0.5))
    for array, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


class TestBadInput:
    simulation = Simulation(PuckStriking(), 2)

    @pytest.mark.parametrize("action", [np.zeros(2), np.zeros((2, 3)), np.zeros((1, 2))])
    def test_actions_of_a_wrong_size(self, action: Array) -> None:
        self.simulation.reset([0, 1])
        with pytest.raises(ValueError, match="action has shape"):
            self.simulation.step(action)

    @pytest.mark.parametrize("wrong", [1.001, -2.0, np.inf, np.nan])
    def test_actions_beyond_the_clip(self, wrong: float) -> None:
        self.simulation.reset([0, 1])
        with pytest.raises(ValueError, match="action"):
            self.simulation.step(np.array([[0.0, 0.0], [0.0, wrong]]))

    def test_rounded_ones_are_none(self) -> None:
        self.simulation.reset([0, 1])
        self.simulation.step(np.full((2, 2), 1.0 + 1e-7))

    def test_a_step_before_a_reset(self) -> None:
        with pytest.raises(ValueError, match="reset"):
            Simulation(PuckStriking(), 1).step(np.zeros((1, 2)))

    def test_seeds_and_starts(self) -> None:
        with pytest.raises(ValueError, match="seeds has 1"):
            self.simulation.reset([0])
        with pytest.raises(ValueError, match="seeds has -1"):
            self.simulation.reset([0, -1])
        with pytest.raises(ValueError, match="effector"):
            self.simulation.reset([0, 1], effector=pair(0.4, 0.0))
        with pytest.raises(ValueError, match="puck"):
            self.simulation.reset([0, 1], puck=np.full((2, 2), np.nan))

    def test_sizes(self) -> None:
        with pytest.raises(ValueError, match="count is 0"):
            Simulation(PuckStriking(), 0)
        with pytest.raises(ValueError, match="horizon is 0"):
            Simulation(PuckStriking(), 1, 0)

    def test_unknown_variants(self) -> None:
        with pytest.raises(ValueError, match="embodiment is 'foot'"):
            SafeManipulation("foot")  # type: ignore[arg-type]
        with pytest.raises(ValueError, match="score is 'miss'"):
            DynamicHitting("miss")  # type: ignore[arg-type]
