"""The adapted environments against D4RL's rules, and against files that others made."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import h5py
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lfobench.errors import UserError
from suites.hand import HORIZONS, identifier, rewards
from tools.adroit_measure import open_loop, recorded, step_by_step

EXTERNAL = Path(__file__).resolve().parents[4] / "shared" / "data"
outside = pytest.mark.skipif(not EXTERNAL.is_dir(), reason="the external files are not beside this repository")
each = pytest.mark.parametrize("name", HORIZONS)
metres = st.floats(-1, 1)
position = st.tuples(metres, metres, metres).map(np.array)


def made(name: str) -> tuple[gymnasium.Env[Any, Any], Any]:
    simulator = gymnasium.make(identifier(name))
    return simulator, simulator.unwrapped


@each
def test_time_ends_an_episode_and_a_step_tells_its_success(name: str) -> None:
    simulator, _ = made(name)
    simulator.reset(seed=0)
    still = np.zeros(simulator.action_space.shape, np.float32)
    steps = [simulator.step(still) for _ in range(HORIZONS[name])]
    assert [truncated for *_, truncated, _ in steps] == [False] * (HORIZONS[name] - 1) + [True]
    assert not any(terminated for _, _, terminated, _, _ in steps)
    assert [information for *_, information in steps] == [{"success": False}] * len(steps), "outcomes would count"
    simulator.close()


@each
def test_the_seed_decides_the_start_and_actions_are_clipped(name: str) -> None:
    simulator, _ = made(name)
    starts = [simulator.reset(seed=seed)[0] for seed in (1, 2, 1)]
    assert not np.array_equal(starts[0], starts[1])
    np.testing.assert_array_equal(starts[0], starts[2])
    far = np.full(simulator.action_space.shape, 5.0, np.float32)
    beyond = simulator.step(far)[0]
    simulator.reset(seed=1)
    np.testing.assert_array_equal(simulator.step(far / 5)[0], beyond)
    simulator.close()


def test_a_dropped_pen_ends_the_episode() -> None:
    simulator, inner = made("pen")
    simulator.reset(seed=0)
    place, velocity = inner.data.qpos.copy(), inner.data.qvel.copy()
    place[-6] += 0.2  # metres that the pen hangs lower
    inner.set_state(place, velocity)
    _, reward, terminated, truncated, _ = simulator.step(np.zeros(24, np.float32))
    assert terminated and not truncated
    assert -7 < float(reward) < -4
    simulator.close()


@given(position, position, st.floats(-0.1, 1.57), st.floats(0, 30))
@settings(max_examples=50)
def test_a_nearer_palm_is_better(palm, object_, hinge, speed) -> None:
    assume(np.linalg.norm(palm - object_) > 1e-6)
    velocities, nearer = np.array([speed, 0.0]), (palm + object_) / 2
    assert rewards.door(nearer, object_, hinge, velocities) > rewards.door(palm, object_, hinge, velocities)
    one, other = (rewards.hammer(at, object_, object_, palm, palm, velocities) for at in (nearer, palm))
    assert one > other


def reward_of_pen(height: float, away: float, cosine: float) -> float:
    place, direction = np.array([0.1, 0.2, height]), np.array([0.0, 0.6, 0.8])
    wanted = cosine * direction + np.sqrt(1 - cosine**2) * np.array([0.0, 0.8, -0.6])
    return rewards.pen(place, place + away * np.array([0.6, 0.0, 0.8]), direction, wanted)


def reward_of_door(hinge: float) -> float:
    """Palm 0.5 m from the handle, squares of velocities that sum to 2500: costs of 0.05 and 0.025."""
    return rewards.door(np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.6, 0.3]), hinge, np.array([30.0, -40.0]))


def reward_of_hammer(handle_height: float, head_height: float, left: float) -> float:
    """Palm 0.5 m from the handle, head 0.25 m from the nail, velocities of norm 50: costs of 0.05, 0.25 and 0.5."""
    palm, handle = np.array([0.3, 0.4, handle_height]), np.array([0.0, 0.0, handle_height])
    head, nail = np.array([1.0, 0.0, head_height]), np.array([1.0, 0.15, head_height + 0.2])
    return rewards.hammer(palm, handle, head, nail, nail + left * np.eye(3)[1], np.array([30.0, -40.0]))


@pytest.mark.parametrize(
    ("reward", "arguments", "expected"),
    [
        (reward_of_pen, (0.076, 0.05, 0.89), 0.89 - 0.05),
        (reward_of_pen, (0.076, 0.05, 0.91), 0.91 - 0.05 + 10),
        (reward_of_pen, (0.076, 0.05, 0.94), 0.94 - 0.05 + 10),
        (reward_of_pen, (0.076, 0.05, 0.96), 0.96 - 0.05 + 60),
        (reward_of_pen, (0.076, 0.074, 0.96), 0.96 - 0.074 + 60),
        (reward_of_pen, (0.076, 0.076, 0.96), 0.96 - 0.076),
        (reward_of_pen, (0.074, 0.05, 0.96), 0.96 - 0.05 + 60 - 5),
        (reward_of_door, (0.19,), -0.19044 - 0.075),
        (reward_of_door, (0.21,), 2 - 0.18496 - 0.075),
        (reward_of_door, (0.99,), 2 - 0.03364 - 0.075),
        (reward_of_door, (1.01,), 10 - 0.03136 - 0.075),
        (reward_of_door, (1.34,), 10 - 0.00529 - 0.075),
        (reward_of_door, (1.36,), 20 - 0.00441 - 0.075),
        (reward_of_hammer, (0.041, 0.039, 0.021), -0.8 - 0.21),
        (reward_of_hammer, (0.039, 0.041, 0.021), -0.8 - 0.21),
        (reward_of_hammer, (0.041, 0.041, 0.021), 2 - 0.8 - 0.21),
        (reward_of_hammer, (0.041, 0.041, 0.019), 27 - 0.8 - 0.19),
        (reward_of_hammer, (0.041, 0.041, 0.011), 27 - 0.8 - 0.11),
        (reward_of_hammer, (0.041, 0.041, 0.009), 102 - 0.8 - 0.09),
    ],
)
def test_every_term_of_a_reward_is_the_published_one(reward, arguments, expected) -> None:
    """By hand, no cost at zero, on both sides of every threshold."""
    assert reward(*arguments) == pytest.approx(expected, abs=1e-12)


def test_bonuses_come_at_the_published_thresholds() -> None:
    here, still = np.zeros(3), np.zeros(2)
    opened = [rewards.door(here, here, angle, still) + 0.1 * (angle - 1.57) ** 2 for angle in (0.1, 0.3, 1.1, 1.4)]
    np.testing.assert_allclose(opened, [0, 2, 10, 20], atol=1e-12)
    up, lefts = np.array([0.0, 0.0, 0.1]), np.array([0.03, 0.015, 0.005])
    driven = [rewards.hammer(up, up, up, up, up + left * np.eye(3)[2], still) + 10 * left for left in lefts]
    np.testing.assert_allclose(driven, [2, 27, 102], atol=1e-12)
    ahead, near = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.2])
    wanted = [np.array([cosine, np.sqrt(1 - cosine**2), 0]) for cosine in (0.8, 0.92, 0.97)]
    turned = [rewards.pen(near, near, ahead, direction) - direction[0] for direction in wanted]
    np.testing.assert_allclose(turned, [0, 10, 60], atol=1e-12)
    low = np.array([0.0, 0.0, 0.07])
    assert rewards.pen(low, low, ahead, ahead) == pytest.approx(1 + 60 - 5)


def test_the_package_is_loaded_late_and_says_nothing() -> None:
    """Its first import prints a notice, so this takes a process of its own."""
    code = (
        "import sys; from suites.adroit import SUITE; assert 'gymnasium' not in sys.modules;"
        "SUITE.tasks[0].environment.make().reset(seed=0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium_robotics.envs.adroit_hand.adroit_pen", None)
    with pytest.raises(UserError, match="pip install 'gymnasium-robotics"):
        gymnasium.make(identifier("pen"))


@outside
@each
def test_starts_and_first_steps_are_those_of_the_files(name: str) -> None:
    """To the last bit of a float32; the state that later steps start from was not stored whole."""
    file = EXTERNAL / f"{name}-external-expert.hdf5"
    of_reward, of_observation = step_by_step(name, file, range(20), steps=1)
    assert of_reward.max() < 1e-6
    assert of_observation.max() < 1e-6
    of_reward, _ = step_by_step(name, file, range(2), steps=40)
    assert np.median(of_reward) < 0.01


@outside
def test_rewards_are_those_of_the_files() -> None:
    """Rewards of every step of door and pen, from recorded observations and velocities."""
    with h5py.File(EXTERNAL / "door-external-expert.hdf5") as root:
        after = root["next_observations"][:-1].astype(np.float64)
        velocities = root["infos/qvel"][1:].astype(np.float64)
        within, recorded_rewards = ~root["timeouts"][:-1], root["rewards"][:-1]
    found = [
        rewards.door(row[29:32], row[32:35], float(row[28]), speed)
        for row, speed in zip(after[within], velocities[within], strict=True)
    ]
    np.testing.assert_allclose(found, recorded_rewards[within], atol=2e-6)
    with h5py.File(EXTERNAL / "pen-external-expert.hdf5") as root:
        after, recorded_rewards = root["next_observations"][:].astype(np.float64), root["rewards"][:]
    found = [rewards.pen(row[24:27], row[24:27] - row[39:42], row[33:36], row[36:39]) for row in after]
    np.testing.assert_allclose(found, recorded_rewards, atol=2e-6)


@outside
def test_human_demonstrations_open_the_door_as_they_did() -> None:
    """Four of 25; `tools.adroit_measure` plays all."""
    file, some = EXTERNAL / "door-human-dapg.hdf5", range(8, 12)
    played, told = open_loop(file, some), recorded("door", file)
    np.testing.assert_allclose(played.returns, told.returns[8:12], rtol=0.05)
    assert (played.successful_steps > 0).tolist() == [True, False, False, True]
    with h5py.File(file) as root:
        begin = np.flatnonzero(root["timeouts"][:])[10] + 1
        first = root["rewards"][begin : begin + 200].sum(dtype=np.float64)
    np.testing.assert_allclose(open_loop(file, range(11, 12), steps=200).returns, first, rtol=0.05)
