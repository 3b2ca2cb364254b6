"""Make one policy: ``python -m suites.hand.distil --environment pen --policy expert --teacher TEACHER.npz``.

An expert is distilled from a teacher (``suites.demonstrators.distil`` says how). A clone (``--policy clone``) needs
none: it is fitted to the scripted demonstrations that the tasks ``…-human-expert`` are generated from, all of them.
"""

from __future__ import annotations

import dataclasses
import hashlib
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console

from lfobench.contract.episodes import Episodes, concatenate
from lfobench.contract.suite import Environment, Recipe, Task
from lfobench.data.generated import roll_out
from lfobench.errors import UserError, unknown_name
from lfobench.plan.parts import specification
from suites.adroit import GENERATED, SUITE
from suites.demonstrators.card import LIBRARIES, make_card, shortfall
from suites.demonstrators.dagger import Settings, distil
from suites.demonstrators.distil import write_policy
from suites.demonstrators.measure import measure, without_noise
from suites.demonstrators.policy import GaussianTanhPolicy
from suites.demonstrators.teacher import read_teacher
from suites.hand.clone import CloneSettings, clone
from suites.hand.levels import WEIGHTS, demonstrator

HUMAN = {task.environment.name: task for task in SUITE.tasks if task.group == "human+expert"}
"""Environment to its task of scripted demonstrations."""


def make_expert(environment: Environment, teacher: Path, settings: Settings, console: Console) -> tuple[bytes, Any]:
    """Weights and card of a student.

    Raises:
        UserError: the teacher cannot be used, or the student is no expert.
    """
    source = read_teacher(teacher)
    weights = distil(environment, source, settings, console.print)
    command = (
        f"python -m suites.hand.distil --environment {environment.name} --policy expert --teacher TEACHER.npz "
        f"--seed {settings.seed} --rounds {settings.rounds}"
    )
    card = make_card(environment, "expert", weights, source, settings, command)
    if missed := shortfall(card):
        raise UserError(f"The student is not expert: {missed}.", "Change --rounds or --seed.")
    return weights, card


def make_clone(task: Task, settings: CloneSettings) -> tuple[bytes, Any]:
    """Weights and card of a clone of a task's scripted demonstrations."""
    environment = task.environment
    rows = demonstrations(task)
    weights = clone(rows.observations[rows.observation_of_transition], rows.actions, settings)
    policy = GaussianTanhPolicy(weights)
    actors = {"sampled": policy.act, "deterministic": without_noise(policy.mean_action)}
    return weights, {
        "environment": dataclasses.asdict(environment),
        "level": "clone",
        "sha256": hashlib.sha256(weights).hexdigest(),
        "licence": "MIT",
        "made_with": (
            f"python -m suites.hand.distil --environment {environment.name} --policy clone --seed {settings.seed}"
        ),
        "method": "behaviour cloning of the scripted demonstrations to a Gaussian tanh MLP",
        "settings": dataclasses.asdict(settings),
        "demonstrations": {
            "part": specification(SUITE, task, GENERATED["human"]).identity,
            "transitions": rows.transitions,
            "episodes": len(rows.lengths),
            "return_mean": float(rows.returns().mean()),
        },
        "levels": {name: dataclasses.asdict(measure(environment, act)) for name, act in actors.items()},
        "versions": {"python": platform.python_version(), **{library: version(library) for library in LIBRARIES}},
    }


def demonstrations(task: Task) -> Episodes:
    """The offline part of the generated source, as a run of the task reads it."""
    assert isinstance(task.recipe, Recipe)
    part = specification(SUITE, task, GENERATED["human"])
    wanted = task.recipe.offline_transitions
    shards = [
        roll_out(part, demonstrator(task.environment.name, part.level), shard)
        for shard in range(part.shards_for(wanted))
    ]
    return concatenate(shards).first_transitions(wanted)


def main(
    environment: Annotated[str, typer.Option(help="pen, door or hammer")],
    policy: Annotated[Literal["expert", "clone"], typer.Option(help="what to make")],
    teacher: Annotated[Path | None, typer.Option(help=".npz of plain arrays; see demonstrators/teacher.py")] = None,
    seed: Annotated[int, typer.Option(help="decides the weights")] = Settings.seed,
    rounds: Annotated[int, typer.Option(help="rounds of DAgger")] = Settings.rounds,
    output: Annotated[Path, typer.Option(help="folder of the weight file and its card")] = WEIGHTS,
) -> None:
    """Make a policy, measure it, and write it with its card."""
    console = Console()
    try:
        if environment not in HUMAN:
            raise unknown_name("environment", environment, HUMAN)
        task = HUMAN[environment]
        if policy == "clone":
            weights, card = make_clone(task, CloneSettings(seed=seed))
        elif teacher is not None:
            weights, card = make_expert(task.environment, teacher, Settings(seed=seed, rounds=rounds), console)
        else:
            raise UserError("An expert is distilled from a teacher.", "Give --teacher FILE.")
    except UserError as error:
        console.print(str(error), style="red")
        raise typer.Exit(2) from error
    card["versions"]["gymnasium-robotics"] = version("gymnasium-robotics")
    for name, measured in card["levels"].items():
        console.print(f"{name}: {measured['score_mean']:.1f} ± {measured['score_std']:.1f}")
    write_policy(output / f"{environment}-{policy}", weights, card, console)


if __name__ == "__main__":
    typer.run(main)
