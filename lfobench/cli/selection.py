"""Which records a view shows and under which rule: the options that tables, plots and reports share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lfobench.cli.inputs import warn

if TYPE_CHECKING:
    from lfobench.api import Selection

StatisticName = Annotated[
    str | None,
    typer.Option(
        "--stat",
        help="Score of a run: last5 (mean of the last 5 evaluations), last, best, at:STEP or success (percentage of "
        "the last policy's episodes). Default: success where every record says how its episodes ended, else last5.",
        show_default=False,
    ),
]
TestName = Annotated[
    str | None,
    typer.Option(
        "--test",
        help="Best against second best: welch, student, mann-whitney, permutation (over seeds); "
        "paired-t, wilcoxon, paired-permutation (over common start states); fisher (success counts). "
        "Default: fisher with --stat success, else welch.",
        show_default=False,
    ),
]
ScopeName = Annotated[str, typer.Option("--scope", help="Who competes: group (methods without expert actions) or all.")]
CorrectionName = Annotated[str, typer.Option("--correction", help="For the number of rows tested: none, holm or bh.")]
Alpha = Annotated[float, typer.Option(help="Level of the test, between 0 and 1.")]
SuiteFilter = Annotated[
    str | None, typer.Option("--suite", help="Only records of this suite (name, or path of its file).")
]
ProtocolFilter = Annotated[str | None, typer.Option("--protocol", help="Only records of this protocol.")]
StepsFilter = Annotated[int | None, typer.Option("--steps", help="Only records of this many gradient steps.")]
SourceFilter = Annotated[str | None, typer.Option("--source", help="Only records of this source.")]
PresetFilter = Annotated[str | None, typer.Option("--preset", help="Only records of this preset.")]
MethodsFilter = Annotated[str | None, typer.Option("--methods", help="Comma-separated methods, in column order.")]


def select_records(
    out: Path,
    suite: str | None = None,
    protocol: str | None = None,
    steps: int | None = None,
    source: str | None = None,
    preset: str | None = None,
    methods: str | None = None,
) -> Selection:
    """The records of a folder that pass the filters; warnings of the folder are printed."""
    from lfobench import api

    selection = api.select_records(
        out, suite=suite, protocol=protocol, steps=steps, source=source, preset=preset, methods=methods
    )
    warn(selection.warnings)
    return selection
