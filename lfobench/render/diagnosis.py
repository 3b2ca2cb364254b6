"""What the trajectory doctor says, on a terminal."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from lfobench.contract.diagnosis import Diagnosis, Severity

_STYLES: dict[Severity, str] = {"problem": "bold red", "caution": "yellow", "note": "dim"}


def diagnosis(found: Diagnosis, name: str) -> Iterator[RenderableType]:
    """The parts of what is printed, from top to bottom."""
    yield f"[bold]{escape(name)}[/]: {summary(found)}"
    yield _modes(found)
    if not found.findings:
        yield "Nothing is wrong with it."
    for finding in found.findings:
        yield f"[{_STYLES[finding.severity]}]{finding.severity}[/]  {escape(finding.text)}"


def summary(found: Diagnosis) -> str:
    """``d4rl, 40 episodes of 883 ± 222 steps (17 terminated, 23 cut by time), …``."""
    count = len(found.lengths)
    where = "from the cache" if found.format == "cached" else f"{found.format} layout"
    returns = f"; return {_spread(found.returns)}" if found.returns else ""
    return (
        f"{where}, {sum(found.lengths):,} transitions in {count:,} episodes of {_spread(found.lengths)} "
        f"steps ({found.terminated:,} terminated, {count - found.terminated:,} cut by time); "
        f"{found.observation} observations, {found.action} actions{returns}"
    )


def _modes(found: Diagnosis) -> Table:
    table = Table("rows", "kept", "dropped", "of those kept", title="What each boundary mode keeps")
    for mode in found.modes:
        reasons = (f"{count:,} {reason}" for reason, count in mode.dropped.items() if count)
        odd = (f"{count:,} {what}" for what, count in mode.odd.items() if count)
        table.add_row(mode.name, f"{mode.kept:,}", "\n".join(reasons), "\n".join(odd))
    return table


def _spread(values: tuple[int, ...] | tuple[float, ...]) -> str:
    """Lowest, median and highest value; one number where all are equal."""
    lowest, middle, highest = min(values), statistics.median(values), max(values)
    return f"{lowest:,.6g}" if lowest == highest else f"{lowest:,.6g} to {highest:,.6g} (median {middle:,.6g})"
