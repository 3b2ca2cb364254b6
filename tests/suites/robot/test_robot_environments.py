"""The Gymnasium environments: the checker, the registered ids, one world against many, and bad input."""

from __future__ import annotations

import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, VectorEnv

from suites.robot import ENVIRONMENTS, register_environments
from suites.robot.scene import scene

VARIANTS: list[tuple[str, dict[str, Any], int]] = [
    ("SafeManipulation", {}, 2),
    ("SafeManipulation", {"embodiment": "hand"}, 2),
    ("PuckStriking", {}, 4),
    ("DynamicHitting", {"score": "touch"}, 14),
    ("DynamicHitting", {"score": "hit"}, 14),
]
every = pytest.mark.parametrize(("name", "arguments", "size"), VARIANTS)


@pytest.fixture(autouse=True)
def registered() -> None:
    register_environments()


def make(name: str, **arguments: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(f"lfobench/{name}-v0", **arguments)


def make_many(name: str, count: int, **arguments: Any) -> VectorEnv[Any, Any, Any]:
    return gymnasium.make_vec(f"lfobench/{name}-v0", count, gymnasium.VectorizeMode.VECTOR_ENTRY_POINT, **arguments)


@every
def test_the_checker_has_nothing_to_say(name: str, arguments: dict[str, Any], size: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        environment = make(name, **arguments)
        check_env(environment.unwrapped)
    assert environment.observation_space.shape == (size,)


@every
def test_one_world_and_many_are_the_same(name: str, arguments: dict[str, Any], size: int) -> None:
    single, many = make(name, **arguments), make_many(name, 3, **arguments)
    observation, info = single.reset(seed=8)
    observations, infos = many.reset(seed=[2, 8, 5])
    generator = np.random.default_rng(0)
    assert infos["effector"].shape == (3, 2)
    for _ in range(300):
        assert observation in single.observation_space and observations in many.observation_space
        assert observation.tobytes() == observations[1].tobytes()
        assert set(info) == ({"effector"} if name == "SafeManipulation" else {"effector", "puck"})
        for told in info:
            np.testing.assert_array_equal(info[told], infos[told][1])
        action = generator.uniform(-0.2, 0.2, 2).astype(np.float32)
        observation, reward, terminated, truncated, info = single.step(action)
        observations, rewards, terminations, truncations, infos = many.step(np.stack([action] * 3))
        assert (reward, terminated, truncated) == (rewards[1], terminations[1], truncations[1])
        if terminated or truncated:
            break
    assert infos["_outcome"][1]
    assert info["outcome"] == infos["outcome"][1]


def test_the_limit_on_steps_is_the_vector_forms_own() -> None:
    many = make_many("SafeManipulation", 2, max_episode_steps=5)
    many.reset(seed=1)
    for _ in range(5):
        _, _, terminated, truncated, infos = many.step(np.zeros((2, 2), np.float32))
    assert truncated.all() and not terminated.any()
    assert infos["outcome"].tolist() == ["out of time"] * 2 and infos["_outcome"].all()


def test_out_of_time_in_the_single_form() -> None:
    single = make("DynamicHitting", max_episode_steps=3, horizon=3)
    single.reset(seed=0)
    for _ in range(3):
        _, _, _, truncated, info = single.step(np.zeros(2, np.float32))
    assert truncated and info["outcome"] == "out of time"


def test_the_vector_form_declares_itself() -> None:
    many = make_many("PuckStriking", 4)
    assert many.metadata["autoreset_mode"] == AutoresetMode.DISABLED
    assert many.num_envs == 4 and many.spec is not None
    assert many.single_observation_space.shape == (4,)


def test_seeds_of_the_vector_form() -> None:
    many = make_many("PuckStriking", 3)
    counted, _ = many.reset(seed=4)
    listed, _ = many.reset(seed=[4, 5, 6])
    np.testing.assert_array_equal(counted, listed)
    many.reset(seed=7)
    drawn = many.reset()[0]
    assert len(np.unique(drawn, axis=0)) == 3
    many.reset(seed=7)
    np.testing.assert_array_equal(many.reset()[0], drawn)


def test_ids_are_complete_with_their_module() -> None:
    """In a fresh process, in which nothing has been registered; importing the package alone loads no simulator."""
    program = """
import sys
import suites.robot
assert not {"mujoco", "gymnasium"} & set(sys.modules)
import gymnasium
for name in suites.robot.ENVIRONMENTS:
    gymnasium.make(f"suites.robot.registration:lfobench/{name}-v0").reset(seed=0)
    gymnasium.make_vec(f"suites.robot.registration:lfobench/{name}-v0", num_envs=2).reset(seed=0)
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@every
def test_bad_actions_name_the_field(name: str, arguments: dict[str, Any], size: int) -> None:
    single, many = make(name, **arguments).unwrapped, make_many(name, 2, **arguments)
    single.reset(seed=0)
    many.reset(seed=0)
    for wrong in ([0.0], [0.0, 0.0, 0.0], [0.0, 1.5], [np.nan, 0.0]):
        with pytest.raises(ValueError, match="action"):
            single.step(np.array(wrong))
        with pytest.raises(ValueError, match="action"):
            many.step(np.array([wrong, wrong]))


def test_unknown_variants() -> None:
    with pytest.raises(ValueError, match="embodiment"):
        make("SafeManipulation", embodiment="foot")
    with pytest.raises(ValueError, match="score"):
        make_many("DynamicHitting", 2, score="miss")


def test_a_part_of_the_worlds_is_not_reset_alone() -> None:
    many = make_many("PuckStriking", 2)
    with pytest.raises(ValueError, match="reset_mask"):
        many.reset(seed=0, options={"reset_mask": np.array([True, False])})
    with pytest.raises(ValueError, match="seeds"):
        many.reset(seed=[1])  # type: ignore[arg-type]


def test_scenes_show_what_the_tasks_are_made_of() -> None:
    safe, puck = scene("safe-manipulation-cross-embodiment"), scene("dynamic-hitting")
    assert [disc.role for disc in safe.discs] == ["obstacle"] * 3 + ["goal"]
    assert safe.puck_radius is None and safe.observation_at is not None
    positions = np.array([[0.5, 0.1]])
    np.testing.assert_array_equal(safe.observation_at(positions.astype(np.float32)), positions.astype(np.float32))
    assert puck.discs == () and puck.puck_radius == 0.0315 and puck.observation_at is None
    assert (puck.x, puck.y, puck.downhill) == ((0.0, 1.93), (-0.38, 0.38), -1)
    with pytest.raises(ValueError, match="environment 'pool'"):
        scene("pool")


def test_the_three_are_named() -> None:
    assert ENVIRONMENTS == ("SafeManipulation", "PuckStriking", "DynamicHitting")
