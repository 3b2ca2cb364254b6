"""The kitchen's scripted demonstrator: completed sub-tasks, and independence of memory."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.cells.parts import specification
from lfobench.contract.episodes import FloatArray
from lfobench.data.build import roll_out
from lfobench.errors import UserError
from suites.franka.constants import SUB_TASKS
from suites.franka.demonstrator import FILE, SIGNS, ScriptedDemonstrator, load
from suites.kitchen import SUITE, WITHOUT_GOAL
from tools import kitchen_plan as planning

MIXED = SUITE.tasks[1]
DONE = {
    "microwave": -0.75,
    "kettle": 0.75,
    "light switch": -0.7,
    "slide cabinet": 0.3,
    "bottom burner": -0.9,
    "top burner": -0.9,
}


@cache
def content() -> bytes:
    return FILE.read_bytes()


def at_the_hub(*completed: str, fingers: float = 0.04) -> FloatArray:
    observation = np.zeros(60, np.float32)
    observation[:9] = planning.HUB
    observation[7:9] = fingers
    for name in completed:
        observation[SIGNS[name].coordinate] = DONE[name]
    return observation


def first_action(demonstrator: ScriptedDemonstrator, observation: FloatArray, seed: int = 0) -> bytes:
    return demonstrator.act(observation, np.random.default_rng(seed)).tobytes()


def chosen(demonstrator: ScriptedDemonstrator, *completed: str) -> set[str]:
    """Which sub-tasks are begun in the hub, over forty generators."""
    observation = at_the_hub(*completed)
    toward = {first_action(ScriptedDemonstrator(content(), [name]), observation): name for name in SIGNS}
    return {toward[first_action(demonstrator, observation, seed)] for seed in range(40)}


def test_the_expert_completes_all_four_in_order_in_about_the_demonstrated_rows() -> None:
    task = WITHOUT_GOAL.tasks[0]
    episodes = roll_out(specification(WITHOUT_GOAL, task, "expert"), load("kitchen", "expert"), 0, transitions=1)
    assert episodes.returns().tolist() == [4.0] and episodes.terminated.tolist() == [True]
    assert 165 <= episodes.lengths[0] <= 195
    seen = episodes.observations[:, :30]
    begun = [
        int(np.argmax(SIGNS[name].sense * (seen[:, SIGNS[name].coordinate] - SIGNS[name].limit) > 0))
        for name in SUB_TASKS["complete"][:3]
    ]
    assert begun == sorted(begun) and begun[0] > 0


def test_offline_data_of_mixed_complete_some_but_never_all() -> None:
    part = specification(SUITE, MIXED, "mixed")
    episodes = roll_out(part, load("kitchen", "mixed"), 0, transitions=1)
    assert 1.0 <= episodes.returns()[0] <= 3.0 and episodes.terminated.tolist() == [False]
    assert np.abs(episodes.actions).max() <= 1.0


def test_the_next_sub_task_is_chosen_at_random_in_the_hub() -> None:
    demonstrator = ScriptedDemonstrator(content())
    assert chosen(demonstrator) == set(SIGNS)
    assert chosen(demonstrator, "kettle", "top burner") == set(SIGNS) - {"kettle", "top burner"}


def test_under_mixed_the_last_of_the_scored_is_never_chosen() -> None:
    demonstrator = ScriptedDemonstrator(content(), never=SUB_TASKS["mixed"])
    assert chosen(demonstrator, "microwave", "kettle", "light switch") == {"slide cabinet", "top burner"}
    assert "bottom burner" in chosen(demonstrator, "microwave", "kettle")


def test_it_rests_after_four_and_waits_in_the_hub_for_open_fingers() -> None:
    demonstrator = ScriptedDemonstrator(content())
    four = at_the_hub("microwave", "kettle", "slide cabinet", "top burner")
    waits = at_the_hub(fingers=0.0)
    for observation in (four, waits):
        actions = {first_action(demonstrator, observation, seed) for seed in range(10)}
        assert len(actions) == 1
        # Only what holds the arm against gravity.
        assert np.abs(np.frombuffer(actions.pop(), np.float32)[:7]).max() < 0.35


@given(
    st.lists(st.floats(-3.5, 3.5, width=32), min_size=30, max_size=30), st.sampled_from(["expert", "partial", "mixed"])
)
@settings(max_examples=40, deadline=None)
def test_an_action_is_bounded_and_depends_on_nothing_that_went_before(values: list[float], level: str) -> None:
    demonstrator = levels(level)
    observation = np.array(values, np.float32)
    action = demonstrator.act(observation, np.random.default_rng(5))
    assert action.shape == (9,) and action.dtype == np.float32 and np.abs(action).max() <= 1.0
    demonstrator.act(at_the_hub("kettle"), np.random.default_rng(1))
    assert action.tobytes() == first_action(demonstrator, observation, 5)
    goal = np.full(30, 7.0, np.float32)
    assert action.tobytes() == first_action(demonstrator, np.concatenate((observation, goal)), 5)


@cache
def levels(level: str) -> ScriptedDemonstrator:
    return load("kitchen", level)


def test_levels_act_differently_and_say_so() -> None:
    marks = {levels(level).fingerprint for level in ("expert", "partial", "mixed")}
    assert len(marks) == 3
    assert load("kitchen", "mixed").fingerprint == levels("mixed").fingerprint
    with pytest.raises(UserError, match="level"):
        load("kitchen", "human")
