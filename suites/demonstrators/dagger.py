"""DAgger: the student acts, the teacher says what it would have done (Ross et al., 2011, arXiv:1011.0686)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from lfobench.contract.suite import Environment, FloatArray
from lfobench.errors import UserError
from suites.demonstrators.measure import Act, play, without_noise
from suites.demonstrators.policy import GaussianTanhPolicy
from suites.demonstrators.student import Student
from suites.demonstrators.teacher import Teacher

# Ant without contact forces has 27 columns; teachers of the 111-column Ant saw zeros in the others.
PADDED_INPUTS = {27: 111}


@dataclass(frozen=True)
class Settings:
    """How a student is made; every field is on its card.

    Attributes:
        seed: decides the weights together with the library versions.
        exploration: factor on the teacher's std.
        rounds: of rolling out, labelling and fitting; the teacher acts in the first one only.
        transitions: states labelled per round.
        round_steps: gradient steps after each round.
        final_steps: gradient steps after the last one.
        batch: rows per gradient step.
        rate: first learning rate of each fit.
        hidden: widths of the student's hidden layers.
    """

    seed: int = 0
    exploration: float = 1.0
    rounds: int = 8
    transitions: int = 20_000
    round_steps: int = 3_000
    final_steps: int = 30_000
    batch: int = 1024
    rate: float = 1e-3
    hidden: tuple[int, ...] = (128, 128)


def distil(environment: Environment, teacher: Teacher, settings: Settings, report: Callable[[str], None]) -> bytes:
    """The ``.safetensors`` bytes of a student of `teacher`; the same settings give the same bytes.

    Args:
        environment: where both act.
        teacher: labels every visited state.
        settings: see there.
        report: is told one line per round.
    """
    _check_fit(environment, teacher)
    # More threads sum in another order, and the same seed would give other weights.
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    generator = np.random.default_rng(settings.seed)
    teacher = teacher.calmed(settings.exploration)

    visited, levels = _roll_out(environment, [teacher.act], settings.transitions, generator)
    report(f"round 1 of {settings.rounds}: teacher's return {np.mean(levels):.0f}")
    student = Student(visited, teacher.actions, settings.hidden, teacher.squash)
    rows = [visited]
    for number in range(2, settings.rounds + 1):
        _fit(student, teacher, rows, settings, settings.round_steps)
        policy = GaussianTanhPolicy(student.content())
        # Data is made from sampled actions; the mean action's states are labelled too, since it is measured.
        actors = [policy.act, without_noise(policy.mean_action)]
        visited, levels = _roll_out(environment, actors, settings.transitions, generator)
        report(f"round {number} of {settings.rounds}: student's return {np.mean(levels):.0f}")
        rows.append(visited)
    loss = _fit(student, teacher, rows, settings, settings.final_steps)
    report(f"final loss {loss:.4f}")
    return student.content()


def _check_fit(environment: Environment, teacher: Teacher) -> None:
    simulator = environment.make()
    observations, actions = (
        space.shape[0] for space in (simulator.observation_space, simulator.action_space) if space.shape
    )
    simulator.close()
    if teacher.inputs not in (observations, PADDED_INPUTS.get(observations)) or teacher.actions != actions:
        raise UserError(
            f"The teacher reads {teacher.inputs} columns and gives {teacher.actions}; {environment.id} has "
            f"{observations} and takes {actions}.",
            "Give a teacher of this environment.",
        )


def _roll_out(
    environment: Environment, actors: Sequence[Act], transitions: int, generator: np.random.Generator
) -> tuple[FloatArray, list[float]]:
    """States ``[transitions, obs]`` of episodes in which the actors take turns, and the episodes' returns."""
    states: list[FloatArray] = []
    returns: list[float] = []
    while len(states) < transitions:
        act = actors[len(returns) % len(actors)]
        steps = list(play(environment, act, int(generator.integers(2**31))))
        states += [step.observation for step in steps]
        returns.append(sum(step.reward for step in steps))
    return np.stack(states[:transitions]), returns


def _fit(student: Student, teacher: Teacher, rows: Sequence[FloatArray], settings: Settings, steps: int) -> float:
    observations = np.concatenate(rows)
    labels = teacher.gaussian(observations)
    columns = [torch.from_numpy(column.astype(np.float32)) for column in (observations, *labels)]
    return student.fit(columns, steps, settings.batch, settings.rate)
