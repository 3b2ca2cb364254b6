"""Traces: where the episodes from a task's fixed starts went, whoever runs beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import scene_suite
from scene_suite import REACH, SUITE, Points

from lfobench.contract.episodes import FloatArray
from lfobench.contract.suite import Task
from lfobench.engine.evaluation import start_seed
from lfobench.engine.trained import trace
from lfobench.errors import UserError
from lfobench.python_files import load_file

OWN = load_file(Path(__file__).parents[1] / "own_folder" / "own_suite.py", "suite")
TASKS = {task.environment.name: task for task in SUITE.tasks}
REACHING, STRIKING = TASKS["reach"], TASKS["strike"]


def still(observations: FloatArray) -> FloatArray:
    return np.zeros((len(observations), 2), np.float32)


def test_a_trace_is_what_one_world_does_from_its_fixed_start() -> None:
    starts = [4, 0, 7]
    for found, start in zip(trace(scene_suite.around, REACHING, starts), starts, strict=True):
        world = Points(1, REACH.horizon)
        observation, information = world.reset(seed=[start_seed(REACHING, start)])
        expected, over, told = [information["effector"][0]], False, None
        while not over:
            observation, _, terminated, truncated, information = world.step(scene_suite.around(observation))
            expected.append(information["effector"][0])
            over, told = bool(terminated[0] or truncated[0]), information["outcome"][0]
        assert (found.start, found.outcome, found.puck) == (start, told, None)
        np.testing.assert_array_equal(found.effector, expected)


def test_episodes_end_each_in_its_own_time_and_the_puck_goes_along() -> None:
    traces = trace(scene_suite.around, STRIKING, range(6))
    assert {each.outcome for each in traces} == {"success", "missed"}
    assert len({len(each.effector) for each in traces}) > 1
    for each in traces:
        assert each.puck is not None
        assert each.puck.shape == each.effector.shape
        assert (each.puck[-1, 0] < 0.0) == (each.outcome == "missed")
        assert each.step_seconds == pytest.approx(0.1)


def test_a_method_s_actions_are_traced_in_the_simulator_s_units() -> None:
    environment = OWN.environment("two", identifier="Carts-v0")
    task = replace(REACHING, environment=environment)
    (found,) = trace(lambda seen: np.full((len(seen), 1), 0.5, np.float32), task, [0])
    assert found.effector[:, 0].tolist() == [float(step) for step in range(environment.horizon + 1)]


def test_an_action_that_is_not_finite_is_no_motion() -> None:
    (broken,) = trace(lambda observations: still(observations) * np.float32(np.nan), REACHING, [0])
    assert (broken.outcome, len(broken.effector)) == ("out of time", REACH.horizon + 1)
    assert (broken.effector == broken.effector[0]).all()


def test_an_environment_that_steps_alone_or_keeps_its_secrets_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match="vector_entry_point"):
        trace(still, TASKS["alone"], [0])
    points = gymnasium.spec(REACH.id).vector_entry_point
    assert points is not None
    monkeypatch.setattr(points, "_information", lambda self: {})
    with pytest.raises(UserError, match="reports no 'effector'"):
        trace(still, REACHING, [0])


def test_tasks_of_one_environment_have_starts_of_their_own() -> None:
    first, second = (task for task in SUITE.tasks if task.environment is REACH)
    assert isinstance(first, Task)
    assert (trace(still, first, [0])[0].effector[0] != trace(still, second, [0])[0].effector[0]).any()
