"""The harness from Python: every view that the command line prints, as one function call.

Example::

    import lfobench

    frame = lfobench.load("runs")                      # one row per run and evaluation
    lfobench.table("runs", correction="holm")          # a notebook shows it as HTML
    lfobench.plot("curves", "runs").savefig("curves.pdf")
    lfobench.report("runs", to="report.html")
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from lfobench.contract.failure import Failure
from lfobench.contract.record import Record, Warning
from lfobench.contract.statistic import Statistic
from lfobench.errors import UserError, unknown_name
from lfobench.files import write_text
from lfobench.plan.names import split_names
from lfobench.registry import load_suite, load_suites
from lfobench.render.beside import beside
from lfobench.render.building import build_table
from lfobench.render.formats import export
from lfobench.render.outcomes import OutcomeTable, outcome_table
from lfobench.render.rules import knobs
from lfobench.render.table import Table
from lfobench.stats.highlight import Rule
from lfobench.store.failures import read_failures
from lfobench.store.folder import RecordFolder, select
from lfobench.store.frame import load
from lfobench.store.published import read_publication
from lfobench.words import harmless

if TYPE_CHECKING:
    from typing import Unpack

    from lfobench.render.plots.figure import PaperFigure

__all__ = [
    "Filters",
    "Selection",
    "export",
    "knobs",
    "load",
    "outcomes",
    "plot",
    "report",
    "select_records",
    "table",
]

COLUMN_ORDER = ("dilo", "smodice", "oril", "bco", "bc", "bc-expert")
"""Order of the columns where none is asked for; other methods follow as they first appear."""


class Filters(TypedDict, total=False):
    """Which records of a folder a view shows; what is left out filters nothing."""

    suite: str | None
    protocol: str | None
    steps: int | None
    source: str | None
    preset: str | None
    methods: str | None


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
    columns = split_names(filters.get("methods") or "")
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


def table(
    out: str | Path,
    *,
    statistic: str | None = None,
    test: str | None = None,
    scope: str = "group",
    correction: str = "none",
    alpha: float = 0.05,
    against: str | None = None,
    margin: float = 5.0,
    anyway: bool = False,
    **filters: Unpack[Filters],
) -> Table:
    """The table of a folder of records, as ``lfobench table`` prints it; a notebook shows it as HTML.

    Without a `statistic` and a `test` it shows success counts, compared by Fisher's test, where every record says how
    its episodes ended, and else scores, compared by Welch's. So do a report and the figures (see `knobs`).

    `against` names a publication, whose numbers then stand beside ours, each with the verdict of an equivalence test
    within `margin` points, or of Fisher's test of counts; `anyway` shows them although the source or the protocol is
    another.

    Raises:
        UserError: as the command line says it.
    """
    selection = _selected(out, **filters)
    built = selection.table(*knobs(selection.records, statistic, test, scope, correction, alpha))
    return built if against is None else hold_against(built, against, margin, anyway)


def outcomes(out: str | Path, **filters: Unpack[Filters]) -> OutcomeTable:
    """How the episodes of a folder of records ended, as ``lfobench table --outcomes`` prints it.

    Raises:
        UserError: as the command line says it.
    """
    return _selected(out, **filters).outcomes()


def hold_against(table: Table, publication: str, margin: float, anyway: bool) -> Table:
    """`table` with the numbers of a publication beside ours: its counts beside counts, its scores beside scores.

    Raises:
        UserError: an unknown publication, a margin that is not positive, or numbers that are not comparable.
    """
    return beside(table, read_publication(publication), margin, anyway)


def plot(
    kind: str, out: str | Path, *, statistic: str | None = None, width: str = "column", **filters: Unpack[Filters]
) -> PaperFigure:
    """A figure of a folder of records, as ``lfobench plot`` draws it; its ``caption`` says what it shows.

    Raises:
        UserError: as the command line says it.
    """
    # Imported here because matplotlib is slow to load and nothing else needs it.
    from lfobench.render.plots.kinds import check_kind, draw

    check_kind(kind)
    selection = _selected(out, **filters)
    return draw(kind, selection.table(*knobs(selection.records, statistic)), selection.records, width, COLUMN_ORDER)


def report(
    out: str | Path,
    to: str | Path | None = None,
    *,
    statistic: str | None = None,
    test: str | None = None,
    scope: str = "group",
    correction: str = "none",
    alpha: float = 0.05,
    **filters: Unpack[Filters],
) -> str:
    """The report of a folder of records, one self-contained HTML page; written to `to` where that is given.

    Raises:
        UserError: as the command line says it.
    """
    # Imported here because it loads matplotlib's colours and nothing else needs it.
    from lfobench.render.report.page import report as report_page

    chosen = _selected(out, **filters)
    scored, rule = knobs(chosen.records, statistic, test, scope, correction, alpha)
    page = report_page(chosen.records, chosen.failures, chosen.warnings, scored, rule, chosen.tasks, chosen.methods)
    if to is not None:
        write_text(Path(to), page)
    return page


def _selected(out: str | Path, **filters: Unpack[Filters]) -> Selection:
    selection = select_records(out, **filters)
    for warning in selection.warnings:
        warnings.warn(harmless(f"{warning.what} {warning.remedy}"), stacklevel=3)
    return selection
