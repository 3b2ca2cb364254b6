"""The records of a folder that a view shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypedDict

from lfobench.cells.names import split_names
from lfobench.errors import UserError, unknown_name
from lfobench.record import Failure, Record, Warning
from lfobench.records.folder import RecordFolder, read_failures, select
from lfobench.registry import is_place, load_method, load_suite, load_suites
from lfobench.score import Statistic
from lfobench.stats.highlight import Rule
from lfobench.tables.building import build_table
from lfobench.tables.outcomes import OutcomeTable, outcome_table
from lfobench.tables.table import Table

if TYPE_CHECKING:
    from typing import Unpack

COLUMN_ORDER = ("dilo", "smodice", "oril", "bco", "seabo", "bc", "bc-expert")
"""Order of the columns where none is asked for; other methods follow as they first appear."""


CountedStarts = Literal["all", "published"]
"""The fixed test starts that a view counts: every one, or the first ones, which a publication has."""


class Filters(TypedDict, total=False):
    """Which records of a folder a view shows; what is left out filters nothing."""

    suite: str | None
    protocol: str | None
    steps: int | None
    source: str | None
    preset: str | None
    methods: str | None
    starts: CountedStarts


@dataclass(frozen=True)
class Selection:
    """What a view is made of.

    Attributes:
        records: those that pass the filters.
        failures: crashed runs that pass them and have left no record since.
        warnings: what reading the folder has to say.
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
        return build_table(self.records, statistic, rule, self.tasks, self.methods, self.failures)

    def outcomes(self) -> OutcomeTable:
        """How the episodes of the selected records ended."""
        return outcome_table(self.records, self.tasks, self.methods, self.failures)


def select_records(out: str | Path, **filters: Unpack[Filters]) -> Selection:
    """The records of a folder that pass the filters. A suite may be the path of its file; methods order the columns.

    Raises:
        UserError: no folder, an unknown method, or nothing passes.
    """
    folder = RecordFolder(Path(out))
    read = folder.read_all()
    failures, unread = read_failures(folder, read.records)
    suite = filters.get("suite")
    given = load_suite(suite) if suite is not None and suite.endswith(".py") else None
    wanted: dict[str, str | int | None] = {
        "suite": given.name if given else suite,
        "protocol": filters.get("protocol"),
        "steps": filters.get("steps"),
        "source": filters.get("source"),
        "preset": filters.get("preset"),
    }
    records, failed = select(read.records, **wanted), select(failures, **wanted)
    named = split_names(filters.get("methods") or "")
    columns = [load_method(name).name if is_place(name) else name for name in named]
    present = {record.method for record in records} | {failure.method for failure in failed}
    for column in columns:
        if column not in present:
            raise unknown_name("method among these records", column, present)
    if read.records and not records and not failed:
        raise UserError(
            f"None of the {len(read.records)} records in {out} passes the filters.",
            f"'lfobench status --out {out}' lists what is there.",
        )
    if columns:
        records = [record for record in records if record.method in columns]
        failed = [failure for failure in failed if failure.method in columns]
    if filters.get("starts", "all") == "published":
        records = [record.from_published_starts() for record in records]
    suites = {record.labels.suite for record in records} | {failure.labels.suite for failure in failed}
    registered = load_suites(set() if given else suites)
    known = [given] if given else registered.loaded.values()
    return Selection(
        records,
        failed,
        [*read.warnings, *unread, *registered.broken],
        [task.name for known_suite in known for task in known_suite.tasks],
        columns or COLUMN_ORDER,
    )
