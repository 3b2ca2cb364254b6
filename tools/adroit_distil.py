"""Distillation or cloning of one policy of the hand.

``python -m tools.adroit_distil --environment pen --policy expert --teacher TEACHER.npz``

An expert is distilled from a teacher (see ``tools.locomotion_distil``). A clone (``--policy clone``) needs none: it is
fitted to all scripted demonstrations that the tasks ``…-human-expert`` are generated from.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import torch
import typer
from rich.console import Console

from lfobench.cells.parts import specification
from lfobench.contract.episodes import Episodes, concatenate
from lfobench.contract.suite import FloatArray, Task
from lfobench.data.build import roll_out
from lfobench.errors import UserError, unknown_name
from suites.adroit import GENERATED, SUITE
from suites.hand.levels import WEIGHTS, demonstrator
from tools.distillation import LIBRARIES, Settings, Student, distil, make_card, make_student_card, shortfall
from tools.locomotion_distil import write_policy
from tools.teachers import read_teacher


@dataclass(frozen=True)
class CloneSettings:
    """Settings of a clone; every field is on its card.

    Attributes:
        seed: decides the weights together with the library versions.
        steps: gradient steps.
        batch: rows per step.
        rate: first learning rate.
        hidden: widths of the hidden layers.
        recorded_std: assumed std of a recorded action around its mean, about the least of the clone's own.
    """

    seed: int = 0
    steps: int = 3_000
    batch: int = 256
    rate: float = 1e-3
    hidden: tuple[int, ...] = (128, 128)
    recorded_std: float = 0.05


def clone(observations: FloatArray, actions: FloatArray, settings: CloneSettings) -> bytes:
    """The ``.safetensors`` bytes of a policy fitted to rows ``[N, obs]``, ``[N, act]``; same settings, same bytes.

    A student whose teacher is a Gaussian about every recorded action: the maximum of the actions' likelihood, but for
    the floor under its std.
    """
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    student = Student(observations, actions.shape[1], settings.hidden, squash=False)
    means = torch.from_numpy(actions)
    log_stds = torch.full_like(means, math.log(settings.recorded_std))
    student.fit([torch.from_numpy(observations), means, log_stds], settings.steps, settings.batch, settings.rate)
    return student.content()


SCRIPTED = {task.environment.name: task for task in SUITE.tasks if task.name.endswith("-human-expert")}
"""Environment to its task of scripted demonstrations."""


def make_expert(task: Task, teacher: Path, settings: Settings, console: Console) -> tuple[bytes, Any]:
    """Weights and card of a student in a task's environment.

    Raises:
        UserError: the teacher cannot be used, or the student is no expert.
    """
    environment, source = task.environment, read_teacher(teacher)
    weights = distil(environment, source, settings, console.print)
    command = (
        f"python -m tools.adroit_distil --environment {environment.name} --policy expert --teacher TEACHER.npz "
        f"--seed {settings.seed} --rounds {settings.rounds}"
    )
    card = make_student_card(environment, "expert", weights, source, settings, command, _libraries(task))
    if missed := shortfall(card):
        raise UserError(f"The student is not expert: {missed}.", "Change --rounds or --seed.")
    return weights, card


def make_clone(task: Task, settings: CloneSettings) -> tuple[bytes, Any]:
    """Weights and card of a clone of a task's scripted demonstrations."""
    name, rows = task.environment.name, demonstrations(task)
    weights = clone(rows.observations[rows.observation_of_transition], rows.actions, settings)
    command = f"python -m tools.adroit_distil --environment {name} --policy clone --seed {settings.seed}"
    method = "behaviour cloning of the scripted demonstrations to a Gaussian tanh MLP"
    fitted_to = {
        "part": specification(SUITE, task, GENERATED["human"]).identity,
        "transitions": rows.transitions,
        "episodes": len(rows.lengths),
        "return_mean": float(rows.returns().mean()),
    }
    origin = {"demonstrations": fitted_to}
    fields = dataclasses.asdict(settings)
    return weights, make_card(task.environment, "clone", weights, command, method, fields, origin, _libraries(task))


def _libraries(task: Task) -> tuple[str, ...]:
    return (*LIBRARIES, *task.simulator)


def demonstrations(task: Task) -> Episodes:
    """The offline part of the generated source, as a run of the task reads it."""
    part = specification(SUITE, task, GENERATED["human"])
    wanted = task.recipe.offline_transitions
    assert wanted is not None, "the hand's data is counted in transitions"
    shards = [
        roll_out(part, demonstrator(task.environment.name, part.level), shard)
        for shard in range(part.shards_for(wanted))
    ]
    return concatenate(shards).first_transitions(wanted)


def main(
    environment: Annotated[str, typer.Option(help="pen, door or hammer")],
    policy: Annotated[Literal["expert", "clone"], typer.Option(help="what to make")],
    teacher: Annotated[Path | None, typer.Option(help=".npz of plain arrays; see tools/teachers.py")] = None,
    seed: Annotated[int, typer.Option(help="decides the weights")] = Settings.seed,
    rounds: Annotated[int, typer.Option(help="rounds of DAgger")] = Settings.rounds,
    output: Annotated[Path, typer.Option(help="folder of the weight file and its card")] = WEIGHTS,
) -> None:
    """Make a policy, measure it, and write it with its card."""
    console = Console()
    try:
        if environment not in SCRIPTED:
            raise unknown_name("environment", environment, SCRIPTED)
        task = SCRIPTED[environment]
        if policy == "clone":
            weights, card = make_clone(task, CloneSettings(seed=seed))
        elif teacher is not None:
            weights, card = make_expert(task, teacher, Settings(seed=seed, rounds=rounds), console)
        else:
            raise UserError("An expert is distilled from a teacher.", "Give --teacher FILE.")
    except UserError as error:
        console.print(str(error), style="red")
        raise typer.Exit(2) from error
    for name, measured in card["levels"].items():
        console.print(f"{name}: {measured['score_mean']:.1f} ± {measured['score_std']:.1f}")
    write_policy(output / f"{environment}-{policy}", weights, card, console)


if __name__ == "__main__":
    typer.run(main)
