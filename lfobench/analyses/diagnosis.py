"""The trajectory doctor's findings, on a terminal."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from lfobench.data.doctor import Diagnosis, Severity
from lfobench.text import counted, harmless

_STYLES: dict[Severity, str] = {"problem": "bold red", "caution": "yellow", "note": "dim"}


def diagnosis(found: Diagnosis, name: str) -> Iterator[RenderableType]:
    """The parts of what is printed, from top to bottom."""
    yield f"[bold]{escape(harmless(name))}[/]: {summary(found)}"
    yield _modes(found)
    if not found.findings:
        yield "Nothing is wrong with it."
    for finding in found.findings:
        yield f"[{_STYLES[finding.severity]}]{finding.severity}[/]  {escape(finding.text)}"


def summary(found: Diagnosis) -> str:
    """``d4rl layout, 35,320 transitions in 40 episodes of 883 steps (17 terminated, 23 cut by time), …``."""
    where = "from the cache" if found.format == "cached" else f"{found.format} layout"
    steps = "step" if set(found.lengths) == {1} else "steps"
    others = f"{len(found.lengths) - found.terminated:,} {not_terminated(found)}"
    returns = f"; return {_spread(found.returns)}" if found.returns else ""
    return (
        f"{where}, {counted(sum(found.lengths), 'transition')} in {counted(len(found.lengths), 'episode')} of "
        f"{_spread(found.lengths)} {steps} ({found.terminated:,} terminated, {others}); "
        f"{counted(found.observation, 'observation')}, {counted(found.action, 'action')}{returns}"
    )


def not_terminated(found: Diagnosis) -> str:
    """The end of episodes that no terminal state ended, as far as the file records it."""
    return "cut by time" if found.timeouts else "not terminated"


def _modes(found: Diagnosis) -> Table:
    table = Table("rows", "kept", "dropped", "of those kept", title="What each boundary mode keeps")
    for mode in found.modes:
        reasons = (f"{reason}: {count:,}" for reason, count in mode.dropped.items() if count)
        odd = (f"{what}: {count:,}" for what, count in mode.odd.items() if count)
        table.add_row(mode.name, f"{mode.kept:,}", "\n".join(reasons), "\n".join(odd))
    return table


def _spread(values: tuple[int, ...] | tuple[float, ...]) -> str:
    """Lowest, median and highest value; one number where all are equal."""
    lowest, middle, highest = min(values), statistics.median(values), max(values)
    return f"{lowest:,.6g}" if lowest == highest else f"{lowest:,.6g} to {highest:,.6g} (median {middle:,.6g})"
