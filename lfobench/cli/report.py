"""``lfobench report``: one page that says what the records show."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lfobench.cli import options, selection
from lfobench.cli.console import output


def report(
    to: Annotated[Path, typer.Option(help="The file to write.")] = Path("report.html"),
    out: options.Out = options.DEFAULT_OUT,
    title: Annotated[str | None, typer.Option(help="Heading of the page.")] = None,
    statistic: selection.StatisticName = None,
    test: selection.TestName = None,
    scope: selection.ScopeName = "group",
    correction: selection.CorrectionName = "none",
    alpha: selection.Alpha = 0.05,
    suite: selection.SuiteFilter = None,
    protocol: selection.ProtocolFilter = None,
    steps: selection.StepsFilter = None,
    source: selection.SourceFilter = None,
    preset: selection.PresetFilter = None,
    methods: selection.MethodsFilter = None,
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

    selected = selection.select_records(out, suite, protocol, steps, source, preset, methods)
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
