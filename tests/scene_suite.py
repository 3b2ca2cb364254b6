"""A suite of the tests that is seen from above: a point that is moved to a goal, past a cup; and one that hits a puck.

It has both forms of its simulators, takes microseconds a step and needs no physics.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from lfobench.contract.episodes import Episodes, FloatArray, concatenate
from lfobench.contract.suite import Disc, Environment, Level, Recipe, Scene, Suite, Task

STRIDE = np.array([0.10, 0.05])
"""Metres that an action of 1 moves the point along x and y."""

CUP, GOAL = Disc("cup", "obstacle", (0.5, 0.0), 0.05), Disc("bowl", "goal", (0.9, 0.0), 0.08)
PADDLE, PUCK = 0.04, 0.03


class Points(VectorEnv[Any, Any, Any]):
    """Points on a table, moved by whatever is asked for; worlds that are over may be stepped on."""

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.DISABLED, "render_fps": 10}  # noqa: RUF012

    def __init__(self, num_envs: int, max_episode_steps: int, puck: bool = False) -> None:
        self.num_envs, self.horizon, self.has_puck = num_envs, max_episode_steps, puck
        self.single_observation_space = Box(-np.inf, np.inf, (4 if puck else 2,), np.float32)
        self.single_action_space = Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[FloatArray, dict[str, Any]]:
        seeds = [seed] * self.num_envs if seed is None or isinstance(seed, int) else seed
        draws = [np.random.default_rng(one) for one in seeds]
        self.point = np.array([[0.1, 0.0] + each.uniform(-0.05, 0.05, 2) * [1.0, 5.0] for each in draws])
        self.puck = np.tile([1.5, 0.1], (self.num_envs, 1))
        self.speed = np.full(self.num_envs, -0.05)
        self.time = 0
        return self._observed(), self._information()

    def step(self, actions: Any) -> tuple[FloatArray, Any, Any, Any, dict[str, Any]]:
        if np.isnan(actions).any() or np.shape(actions) != (self.num_envs, 2):
            raise ValueError("action is not two numbers")
        self.point = self.point + actions * STRIDE
        self.time += 1
        late = np.full(self.num_envs, self.time >= self.horizon)
        outcome = np.full(self.num_envs, "out of time", object)
        if self.has_puck:
            self.puck = self.puck + np.stack([self.speed, np.zeros(self.num_envs)], 1)
            touched = np.linalg.norm(self.puck - self.point, axis=1) < PADDLE + PUCK
            self.speed = np.where(touched, 0.05, self.speed)
            success = (self.speed > 0.0) & (self.puck[:, 0] > 1.0)
            failure = self.puck[:, 0] < 0.0
            outcome[failure] = "missed"
        else:
            success = np.linalg.norm(self.point - GOAL.center, axis=1) < GOAL.radius
            failure = np.linalg.norm(self.point - CUP.center, axis=1) < CUP.radius + PADDLE
            outcome[failure] = "cup hit"
        outcome[success] = "success"
        over = success | failure
        ended = over | late
        information = self._information() | {"outcome": np.where(ended, outcome, None), "_outcome": ended}
        return self._observed(), success.astype(np.float64), over, late & ~over, information

    def _observed(self) -> FloatArray:
        parts = [self.point, self.puck] if self.has_puck else [self.point]
        return np.concatenate(parts, 1).astype(np.float32)

    def _information(self) -> dict[str, Any]:
        everywhere = np.ones(self.num_envs, np.bool_)
        found = {"effector": self.point.copy(), "_effector": everywhere}
        return found | ({"puck": self.puck.copy(), "_puck": everywhere} if self.has_puck else {})


class Point(gymnasium.Env[Any, Any]):
    """One of them."""

    def __init__(self, puck: bool = False) -> None:
        self.many = Points(1, 10**9, puck)
        self.observation_space, self.action_space = self.many.single_observation_space, self.many.single_action_space

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[FloatArray, dict[str, Any]]:
        observations, _ = self.many.reset(seed=[seed])
        return observations[0], {}

    def step(self, action: Any) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        observations, rewards, terminated, _, _ = self.many.step(np.asarray(action)[None])
        return observations[0], float(rewards[0]), bool(terminated[0]), False, {}


# The file is loaded as a module of the tests and as a suite, and Gymnasium warns of a second registration.
for name, together in (("Points", Points), ("Alone", None)):
    gymnasium.registry.pop(f"lfobench-tests/{name}-v0", None)
    gymnasium.register(f"lfobench-tests/{name}-v0", Point, vector_entry_point=together)

REACH = Environment("reach", "lfobench-tests/Points-v0", 30, 0.0, 1.0)
STRIKE = Environment("strike", "lfobench-tests/Points-v0", 60, 0.0, 1.0, {"puck": True})
ALONE = Environment("alone", "lfobench-tests/Alone-v0", 30, 0.0, 1.0)


def around(observations: FloatArray) -> FloatArray:
    """Actions ``[n, 2]`` that reach the goal beside the cup."""
    past = observations[:, 0] > 0.6
    aim = np.where(past[:, None], GOAL.center, (0.65, 0.25))
    return np.clip((aim - observations[:, :2]) / STRIDE * 0.5, -0.9, 0.9).astype(np.float32)


class Hand:
    """Moves points to the goal, or anywhere."""

    def __init__(self, environment: str, level: Level) -> None:
        self.puck, self.level = environment == "strike", level

    @property
    def fingerprint(self) -> str:
        return f"hand {self.puck} {self.level}"

    def record(self, episodes: int, generator: np.random.Generator) -> Episodes:
        return concatenate([self._episode(generator) for _ in range(episodes)])

    def _episode(self, generator: np.random.Generator) -> Episodes:
        world = Points(1, 30, self.puck)
        observations, _ = world.reset(seed=[int(generator.integers(2**31))])
        seen, done, ended = [observations[0]], [], False
        while not ended:
            action = around(observations)
            if self.level != "expert":
                action = generator.uniform(-0.5, 0.5, (1, 2)).astype(np.float32)
            observations, reward, terminated, truncated, _ = world.step(action)
            seen.append(observations[0])
            done.append((action[0], float(reward[0])))
            ended = bool(terminated[0] or truncated[0])
        return Episodes(
            np.array(seen, np.float32),
            np.array([action for action, _ in done], np.float32),
            np.array([reward for _, reward in done], np.float32),
            np.array([len(done)]),
            np.array([bool(terminated[0])]),
        )


def scene(environment: str) -> Scene:
    """The table of one of the environments."""
    puck = environment == STRIKE.name
    return Scene(
        x=(0.0, 1.93),
        y=(-0.38, 0.38),
        downhill=-1,
        workspace=((0.05, 1.0), (-0.3, 0.3)),
        discs=() if puck else (CUP, GOAL),
        stride=(float(STRIDE[0]), float(STRIDE[1])),
        effector_radius=PADDLE,
        puck_radius=PUCK if puck else None,
        observation_at=None if puck else lambda positions: positions.astype(np.float32),
    )


def _task(environment: Environment, group: str, uniform: int | None = None) -> Task:
    return Task(
        f"{environment.name}-{group}",
        group,
        environment,
        Recipe.recorded("random", 6, "expert", 4, expert_transitions=uniform),
        100,
    )


SUITE = Suite(
    "above",
    "points seen from above, for tests",
    (_task(REACH, "few"), _task(REACH, "uniform", 20), _task(STRIKE, "few"), _task(ALONE, "few")),
    Hand,
    scene=scene,
)
