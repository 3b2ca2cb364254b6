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
    from lfobench.analyses.power import read_pilot, seeds_needed
    from lfobench.analyses.power_formats import document, json_power
    from lfobench.errors import UserError
    from lfobench.stats.power import Design
    from lfobench.tables.counting import knobs

    chosen = options.select_records(out, suite, protocol, steps, source, preset, methods)
    if not chosen.records:
        raise UserError(f"{out} holds no records.", "Run two seeds of two methods first: they are the pilot.")
    scored, rule = knobs(chosen.records, statistic, test, scope, correction, alpha)
    # Whoever is named competes, with or without expert actions.
    pilot = read_pilot(chosen.records, scored, "all" if methods else rule.scope, chosen.tasks)
    planned = seeds_needed(pilot, Design(effect, power, rule.alpha, rule.test, rule.correction, seeds), workers)
    if as_json:
        output.out(json_power(planned), end="", highlight=False)
    else:
        output.print(document(planned))
