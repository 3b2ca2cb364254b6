"""``lfobench power``: seeds that a comparison needs, what a number of seeds can show, and the hours they take."""

from __future__ import annotations

from typing import Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import output


def power_of_seeds(
    out: options.Out = options.DEFAULT_OUT,
    effect: Annotated[float, typer.Option(help="Difference of two means that must not be missed, in points.")] = 10.0,
    power: Annotated[float, typer.Option(help="Probability of seeing it, if it is there.")] = 0.8,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds per method and task, as you would plan them.")] = 5,
    methods: Annotated[
        str | None,
        typer.Option(help="Comma-separated methods to choose the best two from, per task. Default: --scope."),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Jobs at once, as fast as the pilot's.")] = 1,
    statistic: options.StatisticName = None,
    test: Annotated[
        str,
        typer.Option(help="As in 'lfobench table', but not fisher; numbers of seeds are Welch's whatever it is."),
    ] = "welch",
    scope: options.ScopeName = "group",
    correction: Annotated[str, typer.Option(help="For the number of tasks: none, holm or bh.")] = "holm",
    alpha: options.Alpha = 0.05,
    suite: options.SuiteFilter = None,
    protocol: options.ProtocolFilter = None,
    steps: options.StepsFilter = None,
    source: options.SourceFilter = None,
    preset: options.PresetFilter = None,
    as_json: options.Json = False,
) -> None:
    """Seeds that a comparison needs, from the spread of a pilot: what N seeds can show, and the hours that they take.

    Example: lfobench power --out runs --effect 10 --seeds 5 --methods dilo,smodice
    """
    from lfobench import api
    from lfobench.analyses.power_formats import document, json_power

    with options.printed_warnings():
        planned = api.power(
            out,
            effect=effect,
            power=power,
            seeds=seeds,
            workers=workers,
            statistic=statistic,
            test=test,
            scope=scope,
            correction=correction,
            alpha=alpha,
            suite=suite,
            protocol=protocol,
            steps=steps,
            source=source,
            preset=preset,
            methods=methods,
        )
    if as_json:
        output.out(json_power(planned), end="", highlight=False)
    else:
        output.print(document(planned))
