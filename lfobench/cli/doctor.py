"""``lfobench data doctor``: what is wrong with a data file, or good to know about it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import output, print_json


def doctor(
    file: Annotated[Path, typer.Argument(help="A data file, or the folder of a Minari dataset.")],
    horizon: Annotated[
        int | None,
        typer.Option(min=1, help="Steps after which the environment cuts an episode; ends are checked against it."),
    ] = None,
    to: Annotated[
        Path | None, typer.Option(help="Also draw lengths and returns of the episodes: .png, .svg or .pdf.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Examine the episodes of a D4RL, Minari or robomimic file; the exit code is 1 where it cannot be trained on.

    Example: lfobench data doctor hopper_medium-v2.hdf5 --horizon 1000
    """
    from dataclasses import asdict

    from lfobench.data.isolated import examine_file
    from lfobench.files import replacing
    from lfobench.render.diagnosis import diagnosis
    from lfobench.render.plots.episodes import episodes
    from lfobench.render.plots.figure import format_of
    from lfobench.render.plots.style import WIDTHS

    format_name = None if to is None else format_of(to)
    found = examine_file(file, horizon)
    if as_json:
        print_json({"file": str(file), "usable": found.usable, **asdict(found)})
    else:
        for part in diagnosis(found, file.name):
            output.print(part, soft_wrap=isinstance(part, str))
    if to is not None:
        figure = episodes(found, file.name, WIDTHS["column"])
        with replacing(to) as temporary:
            figure.savefig(temporary, format=format_name)
    raise typer.Exit(0 if found.usable else 1)
