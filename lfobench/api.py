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
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lfobench.cells.cell import Assigned, configure, load_protocol
from lfobench.cells.names import select_tasks
from lfobench.cells.plan import Plan, Request
from lfobench.errors import UserError, unknown_name
from lfobench.files import replacing, writable_folder, write_text
from lfobench.records.folder import RecordFolder, RecordsRead, read_failures, read_folder
from lfobench.records.published import read_publication
from lfobench.registry import give_method, is_place, load_method
from lfobench.selection import COLUMN_ORDER, Filters, Selection, select_records
from lfobench.stats.power import Design
from lfobench.tables.counting import knobs
from lfobench.tables.exporters import export
from lfobench.tables.outcomes import OutcomeTable
from lfobench.tables.published_columns import with_publication
from lfobench.tables.table import Table
from lfobench.text import harmless

if TYPE_CHECKING:
    from typing import Unpack

    from lfobench.analyses.audit import Audit
    from lfobench.analyses.compare import Compared
    from lfobench.analyses.power import SeedPlan
    from lfobench.contract.method import Method
    from lfobench.engine.method_check import Finding
    from lfobench.engine.trained import Trace
    from lfobench.plots.figure import PaperFigure
    from lfobench.schedule.jobs import Forecast, Schedule

__all__ = [
    "Filters",
    "Selection",
    "audit",
    "check",
    "compare",
    "export",
    "knobs",
    "outcomes",
    "plot",
    "power",
    "report",
    "run",
    "select_records",
    "table",
    "video",
]


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


def compare(
    first: str | Path,
    second: str | Path,
    out: str | Path = "runs",
    *,
    allow: Sequence[str] = (),
    statistic: str | None = None,
    test: str | None = None,
    correction: str = "holm",
    alpha: float = 0.05,
    **filters: Unpack[Filters],
) -> Compared:
    """Better, worse or undecided, task by task, as ``lfobench compare`` prints it.

    Args:
        first: a method of `out`, or a folder.
        second: another method, or the folder that is judged against the first.
        out: the folder of both methods.
        allow: conditions in which two folders may differ.
        statistic: as ``--stat``.
        test: as ``--test``.
        correction: for the number of cells.
        alpha: level of the test.
        filters: which records take part.

    Raises:
        UserError: as the command line says it.
    """
    # Imported here, as below, because tables need none of it.
    from lfobench.analyses.compare import NamedRuns, pair_folders, pair_methods
    from lfobench.analyses.compare import compare as judge

    names = str(first), str(second)
    folders = _are_folders(*names)
    if allow and not folders:
        raise UserError(
            "--allow is for two folders: methods of one folder are compared under the same conditions.",
            "Leave it out, or put their records into two folders.",
        )
    found = [_some_selected(name, **filters) for name in (names if folders else (str(out),))]
    scored, rule = knobs(
        [record for each in found for record in each.records], statistic, test, "all", correction, alpha
    )
    if not folders:
        (only,) = found
        return judge(pair_methods(only.records, only.failures, *names, scored, only.tasks, rule), rule, scored)
    reference, subject = (
        NamedRuns(name, heading, each.records, each.failures)
        for name, heading, each in zip(names, "AB", found, strict=True)
    )
    tasks = list(dict.fromkeys(task for each in found for task in each.tasks))
    return judge(pair_folders(reference, subject, scored, tasks, list(allow), rule), rule, scored)


def _are_folders(first: str, second: str) -> bool:
    """Whether both names are folders; refuses one folder, and what can only be a folder and is not there."""
    folders = [_is_folder(name) for name in (first, second)]
    if all(folders):
        return True
    if not any(folders) and os.sep not in first + second:
        return False
    missing = [name for name, there in zip((first, second), folders, strict=True) if not there]
    raise UserError(
        f"'{missing[0]}' is no folder"
        + (f", and '{second if missing[0] == first else first}' is one." if any(folders) else "."),
        "Name two folders of records, or two methods of the folder that --out names.",
    )


def _is_folder(name: str) -> bool:
    try:
        return Path(name).is_dir()
    except OSError:
        return False


def audit(
    publication: str | Path,
    *,
    sizes: Sequence[int] = (),
    methods: Sequence[str] = (),
    test: str = "welch",
    count_test: str = "fisher",
    correction: str = "none",
    alpha: float = 0.05,
) -> Audit:
    """Which highlights of a published table follow from its numbers, as ``lfobench audit`` prints it.

    Args:
        publication: its name, or a CSV file.
        sizes: samples behind each mean, each at least 2; as the file states where there are none.
        methods: that compete, at least two; as the paper says where there are none.
        test: of means, ``welch`` or ``student``.
        count_test: of counts, ``fisher`` or ``boschloo``.
        correction: of the rule, for the number of rows.
        alpha: level of the test.

    Raises:
        UserError: as the command line says it.
    """
    from lfobench.analyses.audit import audit_publication

    return audit_publication(read_publication(str(publication)), sizes, methods, test, count_test, correction, alpha)


def power(
    out: str | Path = "runs",
    *,
    effect: float = 10.0,
    power: float = 0.8,
    seeds: int = 5,
    workers: int = 1,
    statistic: str | None = None,
    test: str = "welch",
    scope: str = "group",
    correction: str = "holm",
    alpha: float = 0.05,
    **filters: Unpack[Filters],
) -> SeedPlan:
    """Seeds that a comparison needs, from the spread of a pilot, as ``lfobench power`` prints it.

    Args:
        out: the pilot's records, two seeds of two methods at the least.
        effect: difference of two means that must not be missed, in points.
        power: probability of seeing it, if it is there.
        seeds: per method and task, as you would plan them.
        workers: jobs at once.
        statistic: as ``--stat``.
        test: as ``--test``.
        scope: which methods compete where none are named among the filters.
        correction: for the number of tasks.
        alpha: level of the test.
        filters: which records take part; methods that are named compete, whatever their group.

    Raises:
        UserError: as the command line says it.
    """
    from lfobench.analyses.power import read_pilot, seeds_needed

    chosen = _some_selected(out, "Run two seeds of two methods first: they are the pilot.", **filters)
    scored, rule = knobs(chosen.records, statistic, test, scope, correction, alpha)
    pilot = read_pilot(chosen.records, scored, "all" if filters.get("methods") else rule.scope, chosen.tasks)
    return seeds_needed(pilot, Design(effect, power, rule.alpha, rule.test, rule.correction, seeds), workers)


def check(
    method: str | type[Method],
    *,
    protocol: str = "smoke",
    preset: str = "released",
    set: Mapping[str, Any] | None = None,
) -> list[Finding]:
    """The rules of the contract, each kept or broken, as ``lfobench check`` prints them.

    Args:
        method: a name, a place or a class.
        protocol: whose budget of the method is checked.
        preset: of the method.
        set: fields of its configuration, ``{"learning_rate": 0.1}``.

    Raises:
        UserError: as the command line says it.
    """
    # Imported here because it loads torch.
    from lfobench.engine.method_check import check_method

    known = load_method(method) if isinstance(method, str) else give_method(method, method.__qualname__)
    return check_method(known, configure(known, preset, load_protocol(protocol), set or {}).config)


MOST_EPISODES = 12
"""Of one film, whose pictures are held in memory until a GIF is whole."""


def video(
    method: str,
    task: str,
    to: str | Path,
    out: str | Path = "runs",
    *,
    seed: int = 0,
    episodes: str = "0",
    tuned: bool | None = None,
    **filters: Unpack[Filters],
) -> tuple[list[Trace], float]:
    """Film a trained policy from above, as ``lfobench video`` does.

    Args:
        method: with records, by its name or place.
        task: of a suite that is seen from above.
        to: the file, ``.gif`` or ``.mp4``.
        out: the folder of records and policies.
        seed: whose policy.
        episodes: fixed starts, e.g. ``0-3``.
        tuned: only a run whose hyperparameters were chosen, or only one whose were not.
        filters: which records are meant.

    Returns:
        what happened, one trace per start, and the film's seconds.

    Raises:
        UserError: as the command line says it.
    """
    # Imported here because they load torch and matplotlib.
    from lfobench.engine.trained import of_seed, outcomes_of, scene_of, starts_of, suite_of, traces_of
    from lfobench.plots.film import Film, movie_format, write_movie

    to = Path(to)
    format_name = movie_format(to)
    method = load_method(method).name if is_place(method) else method
    filters["methods"] = method
    selected = _selected(out, **filters)
    present = {record.task for record in selected.records}
    if present and task not in present:
        raise unknown_name(f"task among the records of {method}", task, present)
    meant = [
        record
        for record in selected.records
        if record.task == task and (tuned is None or (record.tuning is not None) == tuned)
    ]
    record, *others = of_seed(meant, seed)
    if others:
        raise UserError(
            f"{1 + len(others)} runs of {method} on {task} have seed {seed}.",
            "Choose one with --tuned or --untuned, --preset, --protocol, --steps, --source or --suite; runs that "
            "differ by --set alone need folders of their own.",
        )
    found = suite_of(record, filters.get("suite"))
    scene = scene_of(found)
    of_suite = select_tasks(found.tasks, [task])[0]
    writable_folder(to.parent, "--to")
    traces, problems = traces_of(Path(out), record, of_suite, starts_of(episodes, record, MOST_EPISODES))
    for problem in problems:
        warnings.warn(harmless(f"{problem.what} {problem.remedy}"), stacklevel=2)
    title = f"{method} on {task}, seed {seed}"
    film = Film(scene(of_suite.environment.name), title, traces, outcomes_of(selected.records))
    with replacing(to) as temporary:
        write_movie(film, temporary, format_name)
    return traces, len(film) / film.pictures_per_second


def _selected(out: str | Path, **filters: Unpack[Filters]) -> Selection:
    selection = select_records(out, **filters)
    for warning in selection.warnings:
        warnings.warn(harmless(f"{warning.what} {warning.remedy}"), stacklevel=3)
    return selection


def _some_selected(
    out: str | Path, remedy: str = "Run 'lfobench run' first, or name another folder.", **filters: Unpack[Filters]
) -> Selection:
    """The records of a folder, of which there must be some."""
    found = _selected(out, **filters)
    if not found.records:
        raise UserError(f"{out} holds no records.", remedy)
    return found
