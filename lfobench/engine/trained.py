"""The policies that runs left: which record is meant, and what its policy does from the fixed starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from lfobench.cells.names import parse_seeds
from lfobench.contract.environment import ActionBox
from lfobench.contract.episodes import FloatArray
from lfobench.contract.suite import Environment, Scene, Suite, Task
from lfobench.engine.evaluation import start_seed
from lfobench.engine.policy import TrainedPolicy, load_policy
from lfobench.errors import UserError
from lfobench.record import Record, Warning
from lfobench.records.folder import RecordFolder
from lfobench.registry import load_suite, suite_names

Act = Callable[[FloatArray], FloatArray]
"""Raw observations of the simulator ``[n, obs]`` to a method's actions ``[n, act]`` in [-1, 1]."""

STEPS_PER_SECOND = 20.0
"""Steps per second of a simulator whose metadata gives no ``render_fps``."""


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


MOST_STARTS = 100
"""Limit on the lines of one picture; each is an episode."""


def scene_of(suite: Suite) -> Callable[[str], Scene]:
    """Top view of the suite's environments.

    Raises:
        UserError: it has none.
    """
    if suite.scene is None:
        raise UserError(f"Suite '{suite.name}' has no scene: there is nothing to be seen from above.")
    return suite.scene


def suite_of(record: Record, given: str | None) -> Suite:
    """The suite that a record is of: the one that was given by name or path, or else the registered one of its name.

    Raises:
        UserError: there is none.
    """
    if given is None and record.labels.suite not in suite_names():
        raise UserError(
            f"The records are of suite '{record.labels.suite}', which is not registered.",
            "Give the path of its file with --suite.",
        )
    return load_suite(given or record.labels.suite)


def of_seed(records: Sequence[Record], seed: int) -> list[Record]:
    """Records of one seed.

    Raises:
        UserError: there is none.
    """
    if not records:
        raise UserError("There are no runs to draw.", "Run 'lfobench run' first, or name another folder with --out.")
    found = [record for record in records if record.seed == seed]
    if not found:
        seeds = ", ".join(map(str, sorted({record.seed for record in records})))
        raise UserError(f"None of the runs has seed {seed}.", f"Name one of {seeds} with --seed.")
    return found


def outcomes_of(records: Iterable[Record]) -> set[str]:
    """Every way in which an episode of these runs has ended."""
    evaluations = [each for record in records for each in (*record.evaluations, record.further) if each is not None]
    return {outcome for each in evaluations for outcome in each.outcomes or ()}


def starts_of(text: str | None, record: Record, most: int = MOST_STARTS) -> list[int]:
    """The fixed starts by number, e.g. ``0-3``; where none are named, those of the record's evaluations.

    Raises:
        UserError: no such numbers, or too many.
    """
    if text is None:
        return list(range(int(record.identity["protocol"]["evaluation_episodes"])))
    try:
        starts = parse_seeds(text)
    except UserError as error:
        raise UserError(
            f"'{text}' is not a list of episodes.", "Write numbers and rising ranges: 0-3 or 0,2."
        ) from error
    if len(starts) > most:
        raise UserError(f"'{text}' are {len(starts):,} episodes.", f"Name at most {most}.")
    return starts


def policy_of(out: Path, record: Record) -> TrainedPolicy:
    """The policy that a record's run left below `out`.

    Raises:
        UserError: its file is missing or damaged.
    """
    return load_policy(RecordFolder(out), record)


def traces_of(out: Path, record: Record, task: Task, starts: Sequence[int]) -> tuple[list[Trace], list[Warning]]:
    """Episodes of a record's policy, and a warning where they end otherwise than the record says.

    Raises:
        UserError: the policy is missing or damaged, or its environment cannot be traced.
    """
    traces = trace(policy_of(out, record).act, task, starts)
    last = [*record.evaluations[-1:], *([record.further] if record.further else [])]
    recorded = [outcome for evaluation in last for outcome in evaluation.outcomes or ()]
    otherwise = [each for each in traces if each.start < len(recorded) and recorded[each.start] != each.outcome]
    warnings = []
    if otherwise:
        ends = ", ".join(f"start {each.start} {each.outcome} (not {recorded[each.start]})" for each in otherwise)
        what = f"{record.method} on {record.task}, seed {record.seed}, now ends otherwise than its record says: {ends}."
        remedy = "Another machine, or another version of a library, rounds otherwise."
        warnings.append(Warning(what=what, remedy=remedy))
    return traces, warnings
