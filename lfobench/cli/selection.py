"""Which records a view shows, in which order, under which rule: the options that tables, plots and reports share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lfobench.cli.inputs import warn

if TYPE_CHECKING:
    from lfobench.contract.failure import Failure
    from lfobench.contract.record import Record, Warning
    from lfobench.contract.statistic import Statistic
    from lfobench.render.table import Table
    from lfobench.stats.highlight import Rule

StatisticName = Annotated[
    str, typer.Option("--stat", help="Score of a run: last5 (mean of the last 5 evaluations), last, best or at:STEP.")
]
TestName = Annotated[
    str,
    typer.Option(
        "--test",
        help="Best against second best: welch, student, mann-whitney, permutation (over seeds); "
        "paired-t, wilcoxon, paired-permutation (over common start states).",
    ),
]
ScopeName = Annotated[str, typer.Option("--scope", help="Who competes: group (methods without expert actions) or all.")]
CorrectionName = Annotated[str, typer.Option("--correction", help="For the number of rows tested: none, holm or bh.")]
Alpha = Annotated[float, typer.Option(min=0.0, max=1.0, help="Level of the test.")]
SuiteFilter = Annotated[
    str | None, typer.Option("--suite", help="Only records of this suite (name, or path of its file).")
]
ProtocolFilter = Annotated[str | None, typer.Option("--protocol", help="Only records of this protocol.")]
StepsFilter = Annotated[int | None, typer.Option("--steps", help="Only records of this many gradient steps.")]
SourceFilter = Annotated[str | None, typer.Option("--source", help="Only records of this source.")]
PresetFilter = Annotated[str | None, typer.Option("--preset", help="Only records of this preset.")]
MethodsFilter = Annotated[str | None, typer.Option("--methods", help="Comma-separated methods, in column order.")]


@dataclass(frozen=True)
class Selection:
    """What a view is made of.

    Attributes:
        records: those that pass the filters.
        failures: crashed runs of the methods and tasks that are shown.
        warnings: what the folder's reading has to say; printed already.
        tasks: names in row order.
        methods: names in column order.
    """

    records: Sequence[Record]
    failures: Sequence[Failure]
    warnings: Sequence[Warning]
    tasks: Sequence[str]
    methods: Sequence[str]

    def table(self, statistic: Statistic, rule: Rule) -> Table:
        """The table of the selected records."""
        from lfobench.render.building import build_table

        return build_table(self.records, statistic, rule, self.tasks, self.methods, self.failures)


def select_records(
    out: Path,
    suite: str | None = None,
    protocol: str | None = None,
    steps: int | None = None,
    source: str | None = None,
    preset: str | None = None,
    methods: str | None = None,
) -> Selection:
    """The records of a folder that pass the filters; warnings of the folder are printed.

    Raises:
        UserError: no folder, an unknown method, or nothing passes.
    """
    from lfobench.cli import options
    from lfobench.errors import UserError, unknown_name
    from lfobench.plan.names import split_names
    from lfobench.registry import load_suite, suite_names
    from lfobench.store.failures import read_failures
    from lfobench.store.folder import RecordFolder, select

    folder = RecordFolder(out)
    read = folder.read_all()
    failures, unread = read_failures(folder, read.records)
    warnings = [*read.warnings, *unread]
    warn(warnings)
    given = load_suite(suite) if suite is not None and suite.endswith(".py") else None
    name = given.name if given else suite
    filters: dict[str, str | int | None] = {
        "suite": name,
        "protocol": protocol,
        "steps": steps,
        "source": source,
        "preset": preset,
    }
    records = select(read.records, **filters)
    columns = split_names(methods or "")
    present = {record.method for record in records}
    for column in columns:
        if column not in present:
            raise unknown_name("method among these records", column, present)
    if read.records and not records:
        raise UserError(
            f"None of the {len(read.records)} records in {out} passes the filters.",
            f"'lfobench status --out {out}' lists what is there.",
        )
    if columns:
        records = [record for record in records if record.method in columns]
    present_suites = {record.labels.suite for record in records}
    known = [given] if given else [load_suite(each) for each in suite_names() if each in present_suites]
    return Selection(
        records,
        select(failures, **filters),
        warnings,
        [task.name for known_suite in known for task in known_suite.tasks],
        columns or options.DEFAULT_METHODS.split(","),
    )


def make_rule(test: str, scope: str, correction: str, alpha: float) -> Rule:
    """The four knobs as a value.

    Raises:
        UserError: an unknown name.
    """
    from typing import cast, get_args

    from lfobench.errors import unknown_name
    from lfobench.stats.highlight import Rule
    from lfobench.stats.names import Correction, Scope, Test

    for kind, name, known in (
        ("test", test, get_args(Test)),
        ("scope", scope, get_args(Scope)),
        ("correction", correction, get_args(Correction)),
    ):
        if name not in known:
            raise unknown_name(kind, name, known)
    return Rule(cast("Test", test), cast("Scope", scope), cast("Correction", correction), alpha)
