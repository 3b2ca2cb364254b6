"""The kitchen as D4RL scores it: layouts, goals, rewards, ends, seeds."""

from __future__ import annotations

import itertools
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from suites.franka import HORIZON, IDENTIFIER, register_environments
from suites.franka.constants import GOALS, SUB_TASKS, Layout, Variant, goal
from suites.franka.environment import SIZES, Kitchen

STILL = np.zeros(9, np.float32)
FIRST = ("microwave", "kettle", "light switch", "slide cabinet")
MIXED = ("microwave", "kettle", "bottom burner", "light switch")


@cache
def kitchen(variant: Variant = "partial", layout: Layout = "d4rl-with-goal") -> Kitchen:
    """Shared, as a kitchen takes a second to build; every test resets it."""
    return Kitchen(variant, layout)


def complete(environment: Kitchen, names: Sequence[str]) -> tuple[float, bool, dict[str, Any]]:
    """Move the objects of sub-tasks to their goals, and step."""
    for name in names:
        place, wanted = GOALS[name]
        environment.data.qpos[place] = wanted
    environment.data.qvel[9:] = 0.0
    mujoco.mj_forward(environment.model, environment.data)
    _, reward, terminated, truncated, information = environment.step(STILL)
    assert not truncated
    return reward, terminated, information


@pytest.mark.filterwarnings("ignore:.*Box observation space:UserWarning", "ignore:.*render modes:UserWarning")
def test_the_checker_has_nothing_to_say() -> None:
    check_env(kitchen())


def test_a_complete_identifier_makes_it_and_cuts_it_at_the_horizon() -> None:
    register_environments()
    register_environments()
    made = gymnasium.make(f"suites.franka.registration:{IDENTIFIER}", variant="mixed", layout="minari")
    assert made.spec is not None and made.spec.max_episode_steps == HORIZON == 280
    assert made.observation_space.shape == (59,) and made.action_space.shape == (9,)
    made.close()


@pytest.mark.parametrize("layout", SIZES)
def test_the_seed_alone_decides_an_episode(layout: Layout) -> None:
    environment = kitchen("mixed", layout)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 9)).astype(np.float32)

    def episode(seed: int) -> bytes:
        seen = [environment.reset(seed=seed)[0]]
        seen += [environment.step(action)[0] for action in actions]
        assert all(observation in environment.observation_space for observation in seen)
        return np.stack(seen).tobytes()

    first, other = episode(1), episode(2)
    assert episode(1) == first != other


def test_the_layouts_show_one_state() -> None:
    flat, short, full = (kitchen("mixed", layout).reset(seed=4)[0] for layout in SIZES)
    assert flat[:30].tobytes() == short.tobytes()
    np.testing.assert_allclose(short[:9], full[:9], atol=0.0111)
    np.testing.assert_allclose(short[9:], full[18:39], atol=0.011)


@pytest.mark.parametrize(("variant", "scored"), [("complete", FIRST), ("partial", FIRST), ("mixed", MIXED)])
def test_the_last_columns_are_the_goal_of_the_variant(variant: Variant, scored: tuple[str, ...]) -> None:
    """D4RL's numbers."""
    wanted = {
        "bottom burner": {11: -0.88, 12: -0.01},
        "light switch": {17: -0.69, 18: -0.05},
        "slide cabinet": {19: 0.37},
        "microwave": {22: -0.75},
        "kettle": {23: -0.23, 24: 0.75, 25: 1.62, 26: 0.99, 29: -0.06},
    }
    vector = np.zeros(30, np.float32)
    for name in scored:
        for coordinate, value in wanted[name].items():
            vector[coordinate] = value
    np.testing.assert_array_equal(goal(variant), vector)
    if variant != "complete":
        environment = kitchen(variant)
        np.testing.assert_array_equal(environment.reset(seed=0)[0][30:], vector)
        np.testing.assert_array_equal(environment.step(STILL)[0][30:], vector)


@pytest.mark.parametrize("variant", ["partial", "mixed"])
def test_a_return_counts_scored_sub_tasks_and_all_four_end_the_episode(variant: Variant) -> None:
    environment = kitchen(variant)
    orders = list(itertools.permutations(SUB_TASKS[variant]))
    for order in (orders[index] for index in (0, 9, 23)):
        environment.reset(seed=0)
        for count, name in enumerate(order, 1):
            reward, terminated, information = complete(environment, [name])
            assert (reward, terminated) == (1.0, count == 4)
            assert information["completed"] == order[:count]
            if count < 4:
                assert environment.step(STILL)[1:3] == (0.0, False)


def test_two_at_once_are_rewarded_together_and_others_not_at_all() -> None:
    environment = kitchen("mixed")
    _, information = environment.reset(seed=0)
    assert information["completed"] == ()
    assert complete(environment, ["slide cabinet", "top burner"])[:2] == (0.0, False)
    assert complete(environment, ["microwave", "light switch"])[:2] == (2.0, False)
    # What is undone again is not rewarded again.
    environment.data.qpos[22] = 0.0
    assert environment.step(STILL)[1] == 0.0
    reward, _, information = complete(environment, ["microwave"])
    assert reward == 0.0 and set(information["completed"]) == {"microwave", "light switch"}


def test_an_action_beyond_its_bounds_is_clipped() -> None:
    environment = kitchen()
    after = []
    for size in (1.0, 5.0):
        environment.reset(seed=3)
        after.append(environment.step(np.full(9, size, np.float32))[0].tobytes())
    assert after[0] == after[1]


@pytest.mark.parametrize("arguments", [{"variant": "human"}, {"layout": "pixels"}])
def test_an_unknown_variant_or_layout_is_refused(arguments: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"human|pixels"):
        Kitchen(**arguments)


@pytest.mark.slow
def test_the_simulator_is_imported_late_and_says_nothing() -> None:
    program = (
        "import sys, suites.kitchen, suites.franka.registration as r\n"
        "assert 'gymnasium_robotics' not in sys.modules\n"
        "from suites.franka.environment import Kitchen\nKitchen()"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
