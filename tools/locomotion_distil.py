"""Distillation of a locomotion demonstrator: ``python -m tools.locomotion_distil --environment ant --level expert …``.

The teacher is any policy in the layout of ``tools/teachers.py``, or with ``--from-scratch STEPS`` one trained here.
Weights that miss their level (``distillation.shortfall``) are not written.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console

from lfobench.contract.suite import Environment
from lfobench.errors import UserError, unknown_name
from suites.demonstrators import WEIGHTS
from tools.distillation import Settings, distil, make_student_card, shortfall
from tools.locomotion_scratch import train_teacher
from tools.teachers import Teacher, read_teacher


def _environment(name: str) -> Environment:
    # The suite imports this package, so the package cannot import the suite while it loads.
    from suites.locomotion import ENVIRONMENTS

    known = {environment.name: environment for environment in ENVIRONMENTS}
    if name not in known:
        raise unknown_name("environment", name, known)
    return known[name]


def _teacher(environment: Environment, path: Path | None, steps: int | None, seed: int) -> Teacher:
    if path is not None and steps is None:
        return read_teacher(path)
    if steps is not None and path is None:
        return train_teacher(environment, steps, seed)
    raise UserError("A student needs one teacher.", "Give either --teacher FILE or --from-scratch STEPS.")


def main(
    environment: Annotated[str, typer.Option(help="hopper, halfcheetah, walker2d or ant")],
    level: Annotated[Literal["medium", "expert"], typer.Option(help="level that the student must meet")],
    teacher: Annotated[Path | None, typer.Option(help=".npz of plain arrays; see tools/teachers.py")] = None,
    from_scratch: Annotated[int | None, typer.Option(help="environment steps of TQC")] = None,
    seed: Annotated[int, typer.Option(help="decides the weights")] = Settings.seed,
    exploration: Annotated[float, typer.Option(help="factor on the teacher's std")] = Settings.exploration,
    rounds: Annotated[int, typer.Option(help="rounds of DAgger")] = Settings.rounds,
    width: Annotated[int, typer.Option(help="of both hidden layers")] = Settings.hidden[0],
    output: Annotated[Path, typer.Option(help="folder of the weight file and its card")] = WEIGHTS,
) -> None:
    """Distil a teacher into a small policy, measure it, and write it with its card."""
    console = Console()
    try:
        body = _environment(environment)
        settings = Settings(seed=seed, exploration=exploration, rounds=rounds, hidden=(width, width))
        source = _teacher(body, teacher, from_scratch, seed)
        weights = distil(body, source, settings, console.print)
        origin = f"--from-scratch {from_scratch}" if teacher is None else "--teacher TEACHER.npz"
        command = (
            f"python -m tools.locomotion_distil --environment {environment} --level {level} {origin} "
            f"--seed {seed} --exploration {exploration} --rounds {rounds} --width {width}"
        )
        card = make_student_card(body, level, weights, source, settings, command)
        for name, measured in card["levels"].items():
            console.print(f"{name}: {measured['score_mean']:.1f} ± {measured['score_std']:.1f}")
        missed = shortfall(card)
        if missed:
            raise UserError(f"The student is not {level}: {missed}.", "Change --rounds, --exploration or --width.")
    except UserError as error:
        console.print(str(error), style="red")
        raise typer.Exit(2) from error
    write_policy(output / f"{environment}-{level}", weights, card, console)


def write_policy(stem: Path, weights: bytes, card: dict[str, Any], console: Console) -> None:
    """Write a weight file and its card; `stem` is the path of both without suffix."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    stem.with_suffix(".safetensors").write_bytes(weights)
    stem.with_suffix(".json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    console.print(f"wrote {stem.name}.safetensors and {stem.name}.json")


if __name__ == "__main__":
    typer.run(main)
