"""``lfobench plot``, ``video`` and ``report``: figures, films and the page."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import output


class Width(StrEnum):
    """Values of ``--width``."""

    column = "column"
    page = "page"


def plot(
    kind: Annotated[
        str,
        typer.Argument(
            help="curves (score against steps), scores (every seed), profiles (fraction of runs above a score), "
            "improvement (probability that one method beats another), ranking (critical differences), metrics (of "
            "training) or share (scores against the share of successes in the offline data); or a suite, by name or "
            "path, whose tasks are then seen from above."
        ),
    ],
    to: Annotated[Path, typer.Option(help="The file to write: .png, .svg or .pdf.")],
    out: options.Out = options.DEFAULT_OUT,
    width: Annotated[Width, typer.Option(help="Of one column of a paper (3.3 in) or of the page (6.8 in).")] = (
        Width.column
    ),
    statistic: options.StatisticName = None,
    suite: options.SuiteFilter = None,
    protocol: options.ProtocolFilter = None,
    steps: options.StepsFilter = None,
    source: options.SourceFilter = None,
    preset: options.PresetFilter = None,
    methods: options.MethodsFilter = None,
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
    from lfobench import suite_pictures
    from lfobench.errors import UserError
    from lfobench.files import replacing
    from lfobench.plots.figure import WIDTHS, format_of
    from lfobench.plots.kinds import draw
    from lfobench.selection import COLUMN_ORDER
    from lfobench.tables.counting import knobs

    wanted = suite_pictures.View(view, tasks, seed, episodes)
    above = suite_pictures.kind_of(kind, wanted)
    if above and (suite is not None or statistic is not None or metric):
        raise UserError(
            f"--suite, --stat and --metric are for figures of scores; {kind} is a suite.", "Leave them out."
        )
    format_name = format_of(to)
    selected = options.select_records(out, kind if above else suite, protocol, steps, source, preset, methods)
    if above:
        figure = suite_pictures.draw(kind, above, wanted, selected, out, WIDTHS[width.value], options.warn)
    else:
        table = selected.table(*knobs(selected.records, statistic))
        figure = draw(kind, table, selected.records, width.value, COLUMN_ORDER, metric or ())
    with replacing(to) as temporary:
        figure.savefig(temporary, format=format_name)
    output.out(figure.caption, highlight=False)


def video(
    method: Annotated[str, typer.Argument(help="A method with records, e.g. dilo; one from a file by its path.")],
    task: Annotated[str, typer.Argument(help="A task of a suite that is seen from above.")],
    to: Annotated[Path, typer.Option(help="The file to write: .gif, or .mp4 with the extra 'video'.")],
    out: options.Out = options.DEFAULT_OUT,
    seed: Annotated[int, typer.Option(min=0, help="Whose policy.")] = 0,
    episodes: Annotated[
        str, typer.Option("--episodes", "--episode", help="Fixed starts, one after the other, e.g. 0-3.")
    ] = "0",
    tuned: Annotated[
        bool | None,
        typer.Option("--tuned/--untuned", help="A run whose hyperparameters were chosen, or not."),
    ] = None,
    suite: options.SuiteFilter = None,
    protocol: options.ProtocolFilter = None,
    steps: options.StepsFilter = None,
    source: options.SourceFilter = None,
    preset: options.PresetFilter = None,
) -> None:
    """Film a trained policy from above, as fast as it moves; no display and no GPU are needed.

    Example: lfobench video dilo dynamic-hitting-400-expert-hit --out runs --episode 0 --to hit.gif
    """
    from lfobench import api

    with options.printed_warnings():
        traces, seconds = api.video(
            method,
            task,
            to,
            out,
            seed=seed,
            episodes=episodes,
            tuned=tuned,
            suite=suite,
            protocol=protocol,
            steps=steps,
            source=source,
            preset=preset,
        )
    ended = ", ".join(f"start {each.start} {each.outcome}" for each in traces)
    output.out(f"{to}: {seconds:.1f} s; {ended}", highlight=False)


def report(
    to: Annotated[Path, typer.Option(help="The file to write.")] = Path("report.html"),
    out: options.Out = options.DEFAULT_OUT,
    title: Annotated[str | None, typer.Option(help="Heading of the page.")] = None,
    statistic: options.StatisticName = None,
    test: options.TestName = None,
    scope: options.ScopeName = "group",
    correction: options.CorrectionName = "none",
    alpha: options.Alpha = 0.05,
    suite: options.SuiteFilter = None,
    protocol: options.ProtocolFilter = None,
    steps: options.StepsFilter = None,
    source: options.SourceFilter = None,
    preset: options.PresetFilter = None,
    methods: options.MethodsFilter = None,
) -> None:
    """Write a self-contained HTML page: verdict, table with its knobs, learning curves, provenance, commands.

    The knobs given here are those that the page opens with; all others can be set in it. It needs no server and no
    network.

    Example: lfobench report --out runs --to report.html
    """
    from datetime import UTC, datetime

    from lfobench.files import write_text
    from lfobench.html_report.page import TITLE
    from lfobench.html_report.page import report as render
    from lfobench.tables.counting import knobs

    selected = options.select_records(out, suite, protocol, steps, source, preset, methods)
    scored, rule = knobs(selected.records, statistic, test, scope, correction, alpha)
    filters = {
        "--suite": suite,
        "--protocol": protocol,
        "--steps": steps,
        "--source": source,
        "--preset": preset,
        "--methods": methods,
    }
    page = render(
        selected.records,
        selected.failures,
        selected.warnings,
        scored,
        rule,
        selected.tasks,
        selected.methods,
        title=TITLE if title is None else title,
        now=datetime.now(UTC),
        filters=[word for name, value in filters.items() if value is not None for word in (name, str(value))],
    )
    write_text(to, page)
    output.out(f"{to}: {len(page.encode()) / 1e6:.1f} MB, opens in any browser", highlight=False)
