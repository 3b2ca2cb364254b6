"""The harness from Python: every view that the command line prints, as one function call.

Example::

    import lfobench

    frame = lfobench.load("runs")                      # one row per run and evaluation
    lfobench.table("runs", correction="holm")          # a notebook shows it as HTML
    lfobench.plot("curves", "runs").savefig("curves.pdf")
    lfobench.report("runs", to="report.html")
    lfobench.run(["dilo", Mine], suite="locomotion", tasks="hopper-*", protocol="quick").records
"""

from __future__ import annotations

import json
import multiprocessing
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from lfobench.cells.cell import Assigned
from lfobench.cells.names import split_names
from lfobench.cells.plan import Plan, Request
from lfobench.errors import UserError, unknown_name
from lfobench.files import write_text
from lfobench.record import Failure, Record, Warning
from lfobench.records.folder import RecordFolder, RecordsRead, read_failures, read_folder, select
from lfobench.records.published import read_publication
from lfobench.registry import give_method, is_place, load_method, load_suite, load_suites
from lfobench.score import Statistic
from lfobench.stats.highlight import Rule
from lfobench.tables.building import build_table
from lfobench.tables.counting import knobs
from lfobench.tables.exporters import export
from lfobench.tables.outcomes import OutcomeTable, outcome_table
from lfobench.tables.published_columns import with_publication
from lfobench.tables.table import Table
from lfobench.text import harmless

if TYPE_CHECKING:
    from typing import Unpack

    from lfobench.contract.method import Method
    from lfobench.plots.figure import PaperFigure
    from lfobench.schedule.jobs import Forecast, Schedule

__all__ = [
    "Filters",
    "Selection",
    "Starts",
    "export",
    "knobs",
    "outcomes",
    "plot",
    "report",
    "run",
    "select_records",
    "table",
]

COLUMN_ORDER = ("dilo", "smodice", "oril", "bco", "bc", "bc-expert")
"""Order of the columns where none is asked for; other methods follow as they first appear."""


Starts = Literal["all", "published"]
"""The fixed test starts that a view counts: every one, or the first ones, which a publication has."""


class Filters(TypedDict, total=False):
    """Which records of a folder a view shows; what is left out filters nothing."""

    suite: str | None
    protocol: str | None
    steps: int | None
    source: str | None
    preset: str | None
    methods: str | None
    starts: Starts


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


def run(
    methods: str | type[Method] | Sequence[str | type[Method]],
    *,
    suite: str | Path = "locomotion",
    tasks: str | Sequence[str] | None = None,
    seeds: str | Sequence[int] | None = None,
    protocol: str = "auto",
    steps: int | None = None,
    evaluation_every: int | None = None,
    evaluation_episodes: int | None = None,
    final_episodes: int | None = None,
    preset: str = "released",
    set: Mapping[str, Any] | None = None,
    source: str = "auto",
    device: str = "auto",
    precision: str = "auto",
    tuned: bool = False,
    grid: Mapping[str, Sequence[Any]] | None = None,
    rerun: bool = False,
    workers: int | None = None,
    out: str | Path = "runs",
    progress: Callable[[str], None] | None = None,
) -> Selection:
    """Train methods as ``lfobench run`` does, and return what these runs have left; what is done is not redone.

    A method is a name, a place (``file.py``, ``package.module:Class``) or a class. Where no other process can import a
    class (it was typed into a notebook, or into the script that runs), everything runs in this process. Elsewhere there
    are worker processes, which import the script again: call this below ``if __name__ == "__main__":``.

    Args:
        methods: one or several.
        suite: its name, or the path of its file.
        tasks: globs.
        seeds: numbers, or text as ``0-6``.
        protocol: as ``--protocol``.
        steps: as ``--steps``.
        evaluation_every: as ``--evaluation-every``.
        evaluation_episodes: as ``--evaluation-episodes``.
        final_episodes: as ``--final-episodes``.
        preset: as ``--preset``.
        set: ``{"dilo.tau": 3}``.
        source: as ``--source``.
        device: as ``--device``.
        precision: as ``--precision``.
        tuned: as ``--tuned``.
        grid: whose choice, where there are several: ``{"dilo.tau": [1, 3]}``.
        rerun: as ``--rerun``.
        workers: as ``--workers``.
        out: the output folder.
        progress: called with a line for every run that is done, e.g. ``print``.

    Raises:
        UserError: as the command line says it, or if none of the runs has left a record.
        KeyboardInterrupt: after Ctrl-C, when every run is saved; the same call continues.
    """
    # Imported here because it loads the simulators, and views need none of them.
    import torch

    from lfobench.schedule.jobs import arranged, forecast, resolve, within_memory

    # True while a worker process imports the script: `multiprocessing` itself goes by it.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise UserError(
            "lfobench.run was called by one of its own worker processes, which imports the script.",
            'Put the call below: if __name__ == "__main__":',
        )
    given = [methods] if isinstance(methods, (str, type)) else methods
    names = [each if isinstance(each, str) else give_method(each, each.__qualname__).name for each in given]
    wanted = Request(
        methods=",".join(names),
        suite=str(suite),
        tasks=tasks if tasks is None or isinstance(tasks, str) else ",".join(tasks),
        seeds=seeds if seeds is None or isinstance(seeds, str) else ",".join(map(str, seeds)),
        protocol=protocol,
        preset=preset,
        assignments=tuple(f"{field}={json.dumps(value)}" for field, value in (set or {}).items()),
        source=source,
        device=device,
        assigned=Assigned(steps, evaluation_every, evaluation_episodes, final_episodes),
        precision=precision,
        grids=tuple(f"{field}={json.dumps(list(values))[1:-1]}" for field, values in (grid or {}).items()),
    )
    folder = RecordFolder(Path(out))
    plan = resolve(wanted, folder.root if tuned else None)
    read = read_folder(folder.root)
    # The caller's own number of threads: measuring and training set it.
    threads = torch.get_num_threads()
    try:
        todo = within_memory(arranged(plan, read, folder.root, workers, rerun), workers)
        expected = forecast(todo)
        for warning in [*read.warnings, *expected.warnings]:
            warnings.warn(f"{warning.what} {warning.remedy}", stacklevel=2)
        problems = _carry_out(todo, expected, folder.root, progress) if todo.jobs else []
    finally:
        torch.set_num_threads(threads)
    left = _left(plan, read_folder(folder.root), folder)
    if problems and not left.records:
        raise UserError(f"None of the runs has left a record. {problems[0]}.", "The same call tries again.")
    for problem in problems:
        warnings.warn(f"{problem}. The same call tries again.", stacklevel=2)
    return left


def _left(plan: Plan, read: RecordsRead, folder: RecordFolder) -> Selection:
    """What the runs of a plan have left, in its order."""
    order = {run.identity_hash: place for place, run in enumerate(plan.runs)}
    failures, unread = read_failures(folder, read.records)
    return Selection(
        sorted(
            (record for record in read.records if record.identity_hash in order),
            key=lambda record: order[record.identity_hash],
        ),
        [failure for failure in failures if failure.identity_hash in order],
        [*read.warnings, *unread],
        [task.name for task in plan.tasks],
        list(dict.fromkeys(cell.method.name for cell in plan.cells)),
    )


def _carry_out(todo: Schedule, expected: Forecast, out: Path, progress: Callable[[str], None] | None) -> list[str]:
    """Why jobs did not end with their records, in words."""
    from lfobench.schedule.execution import Lines, StopRequest, execute_schedule

    lines = Lines(progress or (lambda line: None))
    tally = execute_schedule(todo, expected, out, StopRequest(), lines)
    if tally.stopped:
        raise KeyboardInterrupt
    return lines.problems


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

    `against` names a publication, whose numbers follow ours in columns of their own, each with the result of an
    equivalence test within `margin` points, or of Fisher's test of counts; `anyway` shows them although the source or
    the protocol is another.

    Raises:
        UserError: as the command line says it.
    """
    selection = _selected(out, **filters)
    built = selection.table(*knobs(selection.records, statistic, test, scope, correction, alpha))
    return built if against is None else compare_with_publication(built, against, margin, anyway)


def outcomes(out: str | Path, **filters: Unpack[Filters]) -> OutcomeTable:
    """How the episodes of a folder of records ended, as ``lfobench table --outcomes`` prints it.

    Raises:
        UserError: as the command line says it.
    """
    return _selected(out, **filters).outcomes()


def compare_with_publication(table: Table, publication: str, margin: float, anyway: bool) -> Table:
    """`table` with published columns: counts where ours are counts, scores where ours are scores.

    Raises:
        UserError: an unknown publication, a margin that is not positive, or numbers that are not comparable.
    """
    return with_publication(table, read_publication(publication), margin, anyway)


def plot(
    kind: str,
    out: str | Path,
    *,
    statistic: str | None = None,
    width: str = "column",
    metric: str | Sequence[str] = (),
    **filters: Unpack[Filters],
) -> PaperFigure:
    """A figure of a folder of records, as ``lfobench plot`` draws it; its ``caption`` says what it shows.

    `metric` names the training metrics of the kind ``metrics``; all of them unless it does.

    Raises:
        UserError: as the command line says it.
    """
    # Imported here because matplotlib is slow to load and nothing else needs it.
    from lfobench.plots.kinds import check_kind, draw

    check_kind(kind)
    selection = _selected(out, **filters)
    return draw(
        kind,
        selection.table(*knobs(selection.records, statistic)),
        selection.records,
        width,
        COLUMN_ORDER,
        [metric] if isinstance(metric, str) else metric,
    )


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
    from lfobench.html_report.page import report as report_page

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
