"""``lfobench plot``: a figure that a paper would show, and the caption that defines it."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lfobench.cli import options, selection
from lfobench.cli.console import output


class Width(StrEnum):
    """What ``--width`` takes."""

    column = "column"
    page = "page"


def plot(
    kind: Annotated[
        str,
        typer.Argument(
            help="curves (score against steps), scores (every seed), profiles (fraction of runs above a score), "
            "improvement (probability that one method beats another), ranking (critical differences) or metrics (of "
            "training); "
            "or a suite, by name or path, whose tasks are then seen from above."
        ),
    ],
    to: Annotated[Path, typer.Option(help="The file to write: .png, .svg or .pdf.")],
    out: options.Out = options.DEFAULT_OUT,
    width: Annotated[Width, typer.Option(help="Of one column of a paper (3.3 in) or of the page (6.8 in).")] = (
        Width.column
    ),
    statistic: selection.StatisticName = None,
    suite: selection.SuiteFilter = None,
    protocol: selection.ProtocolFilter = None,
    steps: selection.StepsFilter = None,
    source: selection.SourceFilter = None,
    preset: selection.PresetFilter = None,
    methods: selection.MethodsFilter = None,
    metric: Annotated[
        list[str] | None, typer.Option("--metric", help="Of kind metrics: which to draw, repeatable. Default: all.")
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            help="Of a suite: paths (demonstrations and what each method does; the default), field (what it commands "
            "where) or hitting (end-effector and puck over time)."
        ),
    ] = None,
    tasks: Annotated[str | None, typer.Option(help="Of a suite: comma-separated globs over its tasks.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of a suite: whose policies are drawn. Default: 0.")] = None,
    episodes: Annotated[
        str | None,
        typer.Option(
            "--episodes",
            "--episode",
            help="Of a suite: fixed starts, e.g. 0-3. Default: those of an evaluation; the first one for hitting.",
        ),
    ] = None,
) -> None:
    """Draw a figure of the records; its caption is printed, and kept in the file.

    Example: lfobench plot curves --out runs --to curves.pdf --width page

    Example: lfobench plot SUITE --view field --tasks 'safe-*' --out runs --to field.pdf
    """
    from lfobench.api import COLUMN_ORDER
    from lfobench.cli import scene
    from lfobench.errors import UserError
    from lfobench.files import replacing
    from lfobench.plots.figure import WIDTHS, format_of
    from lfobench.plots.kinds import draw
    from lfobench.tables.counting import knobs

    wanted = scene.View(view, tasks, seed, episodes)
    above = scene.kind_of(kind, wanted)
    if above and (suite is not None or statistic is not None or metric):
        raise UserError(
            f"--suite, --stat and --metric are for figures of scores; {kind} is a suite.", "Leave them out."
        )
    format_name = format_of(to)
    selected = selection.select_records(out, kind if above else suite, protocol, steps, source, preset, methods)
    if above:
        figure = scene.draw(kind, above, wanted, selected, out, WIDTHS[width.value])
    else:
        table = selected.table(*knobs(selected.records, statistic))
        figure = draw(kind, table, selected.records, width.value, COLUMN_ORDER, metric or ())
    with replacing(to) as temporary:
        figure.savefig(temporary, format=format_name)
    output.out(figure.caption, highlight=False)
