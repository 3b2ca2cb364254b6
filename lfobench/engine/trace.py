"""Where a policy's episodes went: true positions from the fixed test starts, for pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from lfobench.contract.environment import ActionBox
from lfobench.contract.episodes import FloatArray
from lfobench.contract.suite import Environment, Task
from lfobench.engine.evaluation import start_seed
from lfobench.errors import UserError

Act = Callable[[FloatArray], FloatArray]
"""Raw observations of the simulator ``[n, obs]`` to a method's actions ``[n, act]`` in [-1, 1]."""

STEPS_PER_SECOND = 20.0
"""Of a simulator whose metadata gives no ``render_fps``."""


@dataclass(frozen=True)
class Trace:
    """One episode of T steps.

    Attributes:
        start: number k of the fixed start.
        step_seconds: how long a step takes.
        effector: true positions ``[T + 1, 2]`` in metres, from the start on.
        puck: the same of the puck; None where there is none.
        outcome: how it ended, in the environment's words.
    """

    start: int
    step_seconds: float
    effector: NDArray[np.float64]
    puck: NDArray[np.float64] | None
    outcome: str


def trace(act: Act, task: Task, starts: Sequence[int]) -> list[Trace]:
    """The episodes of a policy from the fixed starts of these numbers, in lock step.

    An action that is not finite becomes 0, as in an evaluation: the simulator must not see it.

    Raises:
        UserError: the environment has no form in which many step together, or does not report what a trace is made of.
    """
    worlds = _together(task.environment, len(starts))
    try:
        return _run(act, task, starts, worlds)
    finally:
        worlds.close()


def _run(act: Act, task: Task, starts: Sequence[int], worlds: gymnasium.vector.VectorEnv[Any, Any, Any]) -> list[Trace]:
    observations, information = worlds.reset(seed=[start_seed(task, start) for start in starts])  # type: ignore[arg-type]
    effectors = [[position] for position in _reported(information, "effector", task.environment)]
    pucks = None
    if "puck" in information:
        pucks = [[position] for position in _reported(information, "puck", task.environment)]
    outcomes = [""] * len(starts)
    running = np.ones(len(starts), np.bool_)
    box = ActionBox.of(worlds.single_action_space)
    while running.any():
        actions = act(np.asarray(observations, np.float32))
        # A diverged seed may answer NaN.
        actions = np.where(np.isfinite(actions), actions, np.float32(0.0))
        observations, _, terminated, truncated, information = worlds.step(box.in_units(actions))
        _append(effectors, _reported(information, "effector", task.environment), running)
        if pucks is not None:
            _append(pucks, _reported(information, "puck", task.environment), running)
        over = running & (terminated | truncated)
        for index in np.flatnonzero(over):
            outcomes[index] = str(_reported(information, "outcome", task.environment)[index])
        running &= ~over
    seconds = 1.0 / float(worlds.metadata.get("render_fps") or STEPS_PER_SECOND)
    return [
        Trace(
            start,
            seconds,
            np.array(effectors[index]),
            None if pucks is None else np.array(pucks[index]),
            outcomes[index],
        )
        for index, start in enumerate(starts)
    ]


def _append(paths: list[list[NDArray[Any]]], positions: NDArray[Any], running: NDArray[np.bool_]) -> None:
    for index in np.flatnonzero(running):
        paths[index].append(positions[index])


def _reported(information: Mapping[str, Any], name: str, environment: Environment) -> NDArray[Any]:
    """A copy of what the environment says of all its worlds under this name."""
    if name not in information:
        raise UserError(
            f"Environment '{environment.id}' reports no '{name}' in its info, so no picture of it can be drawn.",
            "An environment with a scene reports effector and outcome, and puck where there is one.",
        )
    return np.array(information[name])


def _together(environment: Environment, count: int) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    worlds = environment.make_many(count)
    if worlds is None:
        raise UserError(
            f"Environment '{environment.id}' has no form in which many step together, so nothing can trace it.",
            "Register it with a vector_entry_point.",
        )
    return worlds
