"""``lfobench data doctor``: what is wrong with a data file or a task's data, or good to know about it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lfobench.cli import options
from lfobench.cli.console import output, print_json
from lfobench.errors import UserError, unknown_name

if TYPE_CHECKING:
    from lfobench.data.doctor import Diagnosis


def doctor(
    subject: Annotated[str, typer.Argument(help="A data file, the folder of a dataset, or a task.")],
    horizon: Annotated[
        int | None, typer.Option(min=1, help="Of a file: steps after which the environment cuts an episode.")
    ] = None,
    to: Annotated[
        Path | None, typer.Option(help="Of a file: also draw lengths and returns of its episodes: .png, .svg or .pdf.")
    ] = None,
    keys: Annotated[
        str | None, typer.Option(metavar="A+B", help="Of a file: what an observation is made of, as keys= in --source.")
    ] = None,
    suite: options.SuiteName = options.DEFAULT_SUITE,
    protocol: options.ProtocolName = "auto",
    source: options.Source = "auto",
    as_json: options.Json = False,
) -> None:
    """Examine the episodes of a file, or of both parts of a task's data; exit code 1 where it cannot be trained on.

    A file is in the layout of D4RL, Minari or robomimic, or an NPZ archive; a folder is a dataset of Minari, of LeRobot
    (version 3), or of NPZ archives.

    Example: lfobench data doctor hopper_medium-v2.hdf5 --horizon 1000

    Example: lfobench data doctor hopper-medium-expert --source d4rl
    """
    owner = _suite_of(subject, suite)
    if owner is not None:
        if horizon is not None or to is not None or keys is not None:
            raise UserError("--horizon, --keys and --to are for a file; a task knows its own.", "Leave them out.")
        found, inside = _of_task(subject, owner, protocol, source)
    else:
        found, inside = _of_file(Path(subject), horizon, to, keys), None
    usable = all(each.usable for each in found.values())
    if as_json:
        print_json(_as_json(subject, found, inside))
    else:
        _show(found, inside)
    raise typer.Exit(0 if usable else 1)


def _suite_of(subject: str, suite: str) -> str | None:
    """Of a task: the suite that has it, which may be any registered one besides the default. None of a file.

    Raises:
        UserError: neither a task nor what a file would be called.
    """
    from lfobench.cli.inputs import registered_suites
    from lfobench.files import exists
    from lfobench.registry import load_suite

    if exists(Path(subject)):
        return None
    owners = registered_suites().owners if suite == options.DEFAULT_SUITE else {}
    owners |= {task.name: suite for task in load_suite(suite).tasks}
    if subject not in owners and not Path(subject).suffix and "/" not in subject:
        raise unknown_name("file or task", subject, owners)
    return owners.get(subject)


def _of_file(file: Path, horizon: int | None, to: Path | None, keys: str | None) -> dict[str, Diagnosis]:
    from lfobench.cells.sources import split_keys
    from lfobench.data.isolated import examine_file
    from lfobench.files import replacing
    from lfobench.plots.episodes import episodes
    from lfobench.plots.figure import WIDTHS, format_of

    format_name = None if to is None else format_of(to)
    found = examine_file(file, horizon, None if keys is None else split_keys(keys))
    if to is not None:
        figure = episodes(found, file.name, WIDTHS["column"])
        with replacing(to) as temporary:
            figure.savefig(temporary, format=format_name)
    return {file.name: found}


def _of_task(name: str, suite: str, protocol: str, source: str) -> tuple[dict[str, Diagnosis], tuple[int, int]]:
    """Both parts, and how many expert rows of how many the offline part holds too."""
    from lfobench.data.doctor import diagnose_part, rows_inside
    from lfobench.data.requested import asked_data

    asked = asked_data(suite, name, protocol, source)
    (task,) = asked.tasks
    data = asked.load(task)
    horizon = task.environment.horizon
    parts = {f"{name}, {part}": diagnose_part(getattr(data, part), horizon) for part in ("offline", "expert")}
    return parts, (rows_inside(data.expert, data.offline), data.expert.transitions)


def _show(found: dict[str, Diagnosis], inside: tuple[int, int] | None) -> None:
    from lfobench.analyses.diagnosis import diagnosis

    for name, each in found.items():
        for part in diagnosis(each, name):
            output.print(part, soft_wrap=isinstance(part, str))
    if inside is not None:
        output.print(
            f"{inside[0]:,} of {inside[1]:,} expert rows are, to the last bit, rows of the offline part; a recipe may "
            "put more there.",
            soft_wrap=True,
        )


def _as_json(subject: str, found: dict[str, Diagnosis], inside: tuple[int, int] | None) -> dict[str, Any]:
    from dataclasses import asdict

    told = [{"usable": each.usable, "terminated": each.terminated, **asdict(each)} for each in found.values()]
    if inside is None:
        return {"file": subject, **told[0]}
    return {"task": subject, "offline": told[0], "expert": told[1], "expert_rows_inside_offline": inside[0]}
