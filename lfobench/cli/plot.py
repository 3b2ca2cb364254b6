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
            "improvement (probability that one method beats another) or ranking (critical differences)."
        ),
    ],
    to: Annotated[Path, typer.Option(help="The file to write: .png, .svg or .pdf.")],
    out: options.Out = options.DEFAULT_OUT,
    width: Annotated[Width, typer.Option(help="Of one column of a paper (3.3 in) or of the page (6.8 in).")] = (
        Width.column
    ),
    statistic: selection.StatisticName = "last5",
    suite: selection.SuiteFilter = None,
    protocol: selection.ProtocolFilter = None,
    steps: selection.StepsFilter = None,
    source: selection.SourceFilter = None,
    preset: selection.PresetFilter = None,
    methods: selection.MethodsFilter = None,
) -> None:
    """Draw a figure of the records; its caption is printed, and kept in the file.

    Example: lfobench plot curves --out runs --to curves.pdf --width page
    """
    from lfobench.api import COLUMN_ORDER
    from lfobench.contract.statistic import parse_statistic
    from lfobench.files import replacing
    from lfobench.render.plots.figure import format_of
    from lfobench.render.plots.kinds import check_kind, draw
    from lfobench.stats.highlight import DEFAULT_RULE

    check_kind(kind)
    format_name = format_of(to)
    counted = parse_statistic(statistic)
    selected = selection.select_records(out, suite, protocol, steps, source, preset, methods)
    table = selected.table(counted, DEFAULT_RULE)
    figure = draw(kind, table, selected.records, width.value, COLUMN_ORDER)
    with replacing(to) as temporary:
        figure.savefig(temporary, format=format_name)
    output.out(figure.caption, highlight=False)
