"""``lfobench data``: data that tasks need: listed, downloaded or generated, checked, forgotten."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lfobench.cli import options
from lfobench.cli.console import INTERRUPTED, errors, one_line, output, print_json
from lfobench.errors import UserError, unknown_name
from lfobench.text import counted

if TYPE_CHECKING:
    from lfobench.contract.suite import DataFile
    from lfobench.data.doctor import Diagnosis
    from lfobench.data.library import Library, Wanted

SuiteArgument = Annotated[str, typer.Argument(help="A suite's name, the path of its file, or a registered task.")]
SourceOption = Annotated[
    str | None, typer.Option("--source", help="Only files of this source. Default: the first that the suite declares.")
]
AnySource = Annotated[str | None, typer.Option("--source", help="Only files of this source. Default: all.")]


def download(
    suite: SuiteArgument,
    tasks: options.Tasks = None,
    source: SourceOption = None,
    from_folder: Annotated[
        Path | None,
        typer.Option("--from", help="Use the files of this folder where they lie, e.g. ~/.d4rl/datasets; fetch none."),
    ] = None,
) -> None:
    """Fetch the files of a suite, resumed where they broke off, each looked at before it counts.

    LFOBENCH_MIRROR names folders on other hosts that are tried first.

    Example: lfobench data download locomotion --source d4rl --tasks 'hopper-*'
    """
    from rich.markup import escape

    from lfobench.cli.options import suite_and_tasks
    from lfobench.cli.progress import display
    from lfobench.data.library import adopt, download
    from lfobench.errors import UserError

    library, needed = library_here(), wanted_of(*suite_and_tasks(suite, tasks), source)
    wanted = [each for each in needed if each.file.addresses]
    if not wanted:
        output.print("Nothing to fetch: these files are your own.")
        return
    if from_folder is not None and not (from_folder := from_folder.expanduser()).is_dir():
        raise UserError(f"No folder {from_folder}.", "Name another with --from.")
    absent: list[str] = []
    refused: list[UserError] = []
    with display(quiet=False) as shown, _stop_told():
        for number, each in enumerate(wanted, start=1):
            name = each.file.name
            bar = shown.bars.add_task(name, total=None, count=f"{number}/{len(wanted)}", note="")

            def report(here: int, total: int | None, bar: Any = bar) -> None:
                shown.bars.update(bar, completed=here, total=total, note=f"{here / 1e6:,.1f} MB")
                shown.tick()

            try:
                note = download(library, each, report) if from_folder is None else adopt(library, each, from_folder)
            except UserError as refusal:
                refused.append(refusal)
                continue
            finally:
                shown.bars.remove_task(bar)
            if note is None:
                absent.append(name)
            else:
                plain = ", fetched over plain HTTP" if note.address.startswith("http:") else ""
                output.print(f"{escape(name)}: {escape(note.path)}, SHA-256 {note.sha256[:16]}…{plain}", soft_wrap=True)
    if absent:
        errors.print(escape(f"Not in {from_folder}: {', '.join(absent)}."), soft_wrap=True)
    if refused:
        for other in refused[1:]:
            errors.print(one_line(str(other)), soft_wrap=True)
        raise refused[0]
    raise typer.Exit(1 if absent else 0)


@contextmanager
def _stop_told() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as stop:
        errors.print("Stopped. The same command continues where it broke off.")
        raise typer.Exit(INTERRUPTED) from stop


def verify(suite: SuiteArgument, tasks: options.Tasks = None, source: AnySource = None) -> None:
    """Hash the files that are here again, and compare with what they were on first use.

    Example: lfobench data verify locomotion
    """
    from lfobench.cli.options import suite_and_tasks
    from lfobench.errors import UserError

    library, here, refused = library_here(), 0, []
    wanted = wanted_of(*suite_and_tasks(suite, tasks), source, every=True)
    if wanted and not any(each.file.addresses for each in wanted):
        output.print("Nothing to verify: these files are your own, and taken as they are.")
        return
    for each in wanted:
        if not each.file.addresses:
            continue
        try:
            note = library.verify(each.source, each.file)
        except UserError as refusal:
            refused.append(refusal)
            continue
        if note is not None:
            output.print(f"{each.source} {each.file.name}: unchanged, SHA-256 {note.sha256}", soft_wrap=True)
            here += 1
    for other in refused[1:]:
        errors.print(one_line(str(other)), soft_wrap=True)
    if refused:
        raise refused[0]
    unchanged = counted(here, "file is what it was", "files are what they were")
    output.print(f"{unchanged}." if here else "None of the files is here.")


def remove(
    suite: SuiteArgument,
    tasks: options.Tasks = None,
    source: AnySource = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Forget the files of a suite and delete what was made of them; what was adopted stays where it lies.

    Example: lfobench data rm locomotion --source d4rl
    """
    from lfobench.cli.options import suite_and_tasks
    from lfobench.data.library import forget, known

    library = library_here()
    here = [each for each in wanted_of(*suite_and_tasks(suite, tasks), source, every=True) if known(library, each)]
    if not here:
        output.print("None of the files is here.")
        return
    names = ", ".join(each.file.name for each in here)
    if not yes and not typer.confirm(f"Remove {names}?"):
        raise typer.Exit(1)
    deleted = sum(forget(library, each) for each in here)
    words = "that was not downloaded stays where it lies", "that were not downloaded stay where they lie"
    stay = f"; {counted(len(here) - deleted, *words)}" if deleted < len(here) else ""
    output.print(f"Forgot {counted(len(here), 'file')}, deleted {deleted}{stay}.")


def library_here() -> Library:
    """Library of the data files of the cache."""
    from lfobench.data.library import Library
    from lfobench.files import cache_folder

    return Library(cache_folder())


def wanted_of(suite: str, tasks: str | None, source: str | None, every: bool = False) -> list[Wanted]:
    """Files of the chosen tasks; without a source, of the suite's first one, or of `every` one."""
    from lfobench.cells.names import chosen_tasks
    from lfobench.data.library import wanted_files
    from lfobench.errors import UserError, unknown_name
    from lfobench.registry import load_suite

    loaded = load_suite(suite)
    chosen = chosen_tasks(loaded, tasks)
    declared = list(dict.fromkeys(name for task in chosen for name in task.files))
    if source is not None and source not in declared:
        raise unknown_name(f"source of {loaded.name}", source, declared)
    if not declared and not every:
        raise UserError(f"Suite '{loaded.name}' has no data files.", "Its data is generated: lfobench data build.")
    return wanted_files(chosen, [source] if source is not None else None if every else declared[:1])


def list_files(
    suite: Annotated[
        str | None, typer.Argument(help="A suite's name, the path of its file, or a registered task. Default: all.")
    ] = None,
    tasks: options.Tasks = None,
    source: AnySource = None,
    as_json: options.Json = False,
) -> None:
    """What files each suite can be read from, which of them are here, and how large they are.

    Example: lfobench data ls locomotion --source d4rl
    """
    from rich.markup import escape
    from rich.table import Table

    from lfobench.cli.options import suite_and_tasks

    rows = _merged([suite_and_tasks(suite, tasks)] if suite else _everywhere(tasks, source), source)
    if as_json:
        print_json(rows)
        return
    if not rows:
        output.print("No data files: everything here is generated.")
        return
    table = Table()
    for header in ("suites", "source", "file", "tasks", "size", "where it lies"):
        table.add_column(header, overflow="fold")
    for row in rows:
        size = "" if row["bytes"] is None else f"{row['bytes'] / 1e6:,.1f} MB"
        where = escape(row["path"]) if row["path"] else "[dim]not here[/]"
        if row["problem"]:
            where = f"[red]{one_line(row['problem'])}[/]"
        first, *others = row["suites"]
        suites = escape(first) + (f" +{len(others)}" if others else "")
        table.add_row(suites, row["source"], escape(row["file"]), str(len(row["tasks"])), size, where)
    output.print(table)


def _everywhere(tasks: str | None, source: str | None) -> list[tuple[str, str | None]]:
    """Every registered suite that has such tasks and files of the source, with the globs that name some of its tasks.

    Raises:
        UserError: for globs that name no task at all, or a source that none of the tasks has.
    """
    from fnmatch import fnmatchcase

    from lfobench.cells.names import split_names
    from lfobench.cli.options import registered_suites
    from lfobench.errors import unknown_name

    globs = ["*"] if tasks is None else split_names(tasks)
    found: list[tuple[str, str | None]] = []
    sources: set[str] = set()
    known = registered_suites()
    for suite, loaded in known.loaded.items():
        chosen = {glob: [task for task in loaded.tasks if fnmatchcase(task.name, glob)] for glob in globs}
        matching = [glob for glob, tasks_of_glob in chosen.items() if tasks_of_glob]
        declared = {name for tasks_of_glob in chosen.values() for task in tasks_of_glob for name in task.files}
        sources |= declared
        if matching and (source is None or source in declared):
            found.append((suite, ",".join(matching)))
    if not found and source is not None and sources:
        raise unknown_name("source", source, sources)
    if not found:
        raise unknown_name("task", tasks or "*", known.owners)
    return found


def _merged(chosen: list[tuple[str, str | None]], source: str | None) -> list[dict[str, Any]]:
    """A row per file, whichever suites read it."""
    rows: dict[tuple[str, DataFile], dict[str, Any]] = {}
    for suite, tasks in chosen:
        for row, file in _rows(suite, tasks, source):
            known = rows.setdefault((row["source"], replace(file, columns=None, keys=None)), row)
            for field in ("suites", "tasks"):
                known[field] = list(dict.fromkeys((*known[field], *row[field])))
    return list(rows.values())


def _rows(suite: str, tasks: str | None, source: str | None) -> Iterator[tuple[dict[str, Any], DataFile]]:
    from lfobench.registry import load_suite

    library = library_here()
    for each in wanted_of(suite, tasks, source, every=True):
        row = {
            "suites": [load_suite(suite).name],
            "source": each.source,
            "file": each.file.name,
            "tasks": list(each.tasks),
            "addresses": list(each.file.addresses),
        }
        yield row | _whereabouts(library, each), each.file


def _whereabouts(library: Library, wanted: Wanted) -> dict[str, Any]:
    from lfobench.errors import UserError
    from lfobench.files import exists

    try:
        note = library.note(wanted.source, wanted.file)
        path = Path(note.path) if note else library.place(wanted.source, wanted.file)
        here = exists(path)
    except UserError as error:
        return {"path": None, "bytes": None, "sha256": None, "problem": str(error)}
    return {
        "path": str(path) if here else None,
        "bytes": _size(path) if here else None,
        "sha256": note.sha256 if note else None,
        "problem": None,
    }


def _size(path: Path) -> int:
    """Bytes of a file, or of all in a folder."""
    return sum(each.stat().st_size for each in path.rglob("*")) if path.is_dir() else path.stat().st_size


def doctor(
    subject: Annotated[str, typer.Argument(help="A data file, the folder of a dataset, or a task.")],
    horizon: Annotated[
        int | None, typer.Option(min=1, help="Of a file: steps after which the environment cuts an episode.")
    ] = None,
    to: Annotated[
        Path | None, typer.Option(help="Of a file: also draw lengths and returns of its episodes: .png, .svg or .pdf.")
    ] = None,
    keys: Annotated[
        str | None, typer.Option(metavar="A+B", help="Of a file: what an observation is made of, as keys= in --source.")
    ] = None,
    suite: options.SuiteName = options.DEFAULT_SUITE,
    protocol: options.ProtocolName = "auto",
    source: options.Source = "auto",
    as_json: options.Json = False,
) -> None:
    """Examine the episodes of a file, or of both parts of a task's data; exit code 1 where it cannot be trained on.

    A file is in the layout of D4RL, Minari or robomimic, or an NPZ archive; a folder is a dataset of Minari, of LeRobot
    (version 3), or of NPZ archives.

    Example: lfobench data doctor hopper_medium-v2.hdf5 --horizon 1000

    Example: lfobench data doctor hopper-medium-expert --source d4rl
    """
    owner = _suite_of(subject, suite)
    if owner is not None:
        if horizon is not None or to is not None or keys is not None:
            raise UserError("--horizon, --keys and --to are for a file; a task knows its own.", "Leave them out.")
        found, inside = _of_task(subject, owner, protocol, source)
    else:
        found, inside = _of_file(Path(subject), horizon, to, keys), None
    usable = all(each.usable for each in found.values())
    if as_json:
        print_json(_as_json(subject, found, inside))
    else:
        _show(found, inside)
    raise typer.Exit(0 if usable else 1)


def _suite_of(subject: str, suite: str) -> str | None:
    """Suite of a task, which may be any registered one besides the default; None for a file.

    Raises:
        UserError: neither a task nor what a file would be called.
    """
    from lfobench.cli.options import registered_suites
    from lfobench.files import exists
    from lfobench.registry import load_suite

    if exists(Path(subject)):
        return None
    owners = registered_suites().owners if suite == options.DEFAULT_SUITE else {}
    owners |= {task.name: suite for task in load_suite(suite).tasks}
    if subject not in owners and not Path(subject).suffix and "/" not in subject:
        raise unknown_name("file or task", subject, owners)
    return owners.get(subject)


def _of_file(file: Path, horizon: int | None, to: Path | None, keys: str | None) -> dict[str, Diagnosis]:
    from lfobench.cells.sources import split_keys
    from lfobench.data.isolated import examine_file
    from lfobench.files import replacing
    from lfobench.plots.episodes import episodes
    from lfobench.plots.figure import WIDTHS, format_of

    format_name = None if to is None else format_of(to)
    found = examine_file(file, horizon, None if keys is None else split_keys(keys))
    if to is not None:
        figure = episodes(found, file.name, WIDTHS["column"])
        with replacing(to) as temporary:
            figure.savefig(temporary, format=format_name)
    return {file.name: found}


def _of_task(name: str, suite: str, protocol: str, source: str) -> tuple[dict[str, Diagnosis], tuple[int, int]]:
    """Both parts, and how many expert rows of how many the offline part holds too."""
    from lfobench.data.doctor import diagnose_part, rows_inside
    from lfobench.data.requested import requested_data

    requested = requested_data(suite, name, protocol, source)
    (task,) = requested.tasks
    data = requested.load(task)
    horizon = task.environment.horizon
    parts = {f"{name}, {part}": diagnose_part(getattr(data, part), horizon) for part in ("offline", "expert")}
    return parts, (rows_inside(data.expert, data.offline), data.expert.transitions)


def _show(found: dict[str, Diagnosis], inside: tuple[int, int] | None) -> None:
    from lfobench.analyses.diagnosis import diagnosis

    for name, each in found.items():
        for part in diagnosis(each, name):
            output.print(part, soft_wrap=isinstance(part, str))
    if inside is not None:
        output.print(
            f"{inside[0]:,} of {inside[1]:,} expert rows are, to the last bit, rows of the offline part; a recipe may "
            "put more there.",
            soft_wrap=True,
        )


def _as_json(subject: str, found: dict[str, Diagnosis], inside: tuple[int, int] | None) -> dict[str, Any]:
    from dataclasses import asdict

    diagnoses = [{"usable": each.usable, "terminated": each.terminated, **asdict(each)} for each in found.values()]
    if inside is None:
        return {"file": subject, **diagnoses[0]}
    return {"task": subject, "offline": diagnoses[0], "expert": diagnoses[1], "expert_rows_inside_offline": inside[0]}


app = typer.Typer(name="data", help="Datasets: what is needed and here, fetch, check, build.", no_args_is_help=True)
app.command(name="ls")(list_files)
app.command()(download)
app.command()(verify)
app.command()(doctor)
app.command(name="rm")(remove)


@app.command()
def build(
    suite: SuiteArgument,
    tasks: options.Tasks = None,
    protocol: options.ProtocolName = "auto",
    source: options.Source = "auto",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes. Default: one per core.")] = None,
) -> None:
    """Make a suite's data once, or read it from files, into the cache (LFOBENCH_CACHE overrides where); resumable.

    Example: lfobench data build locomotion --tasks 'hopper-*' --protocol quick
    """
    from lfobench.cli.options import suite_and_tasks
    from lfobench.cli.progress import Terminal, stopping
    from lfobench.data.requested import requested_data
    from lfobench.files import writable_folder
    from lfobench.processes import available_cores
    from lfobench.schedule.execution import StopRequest, build_data

    requested = requested_data(*suite_and_tasks(suite, tasks), protocol, source)
    writable_folder(requested.cache, "LFOBENCH_CACHE")
    shards = requested.missing_shards()
    stop = StopRequest(stopping)
    with stop.listening():
        build_data(shards, workers or available_cores(), stop, Terminal())
    if stop():
        output.print("Stopped. The same command continues from here.")
        raise typer.Exit(INTERRUPTED)
    requested.check_files()
    if not shards:
        output.print("Nothing to build: every shard is there.")


def _amount(row: dict[str, Any]) -> str:
    return f"{row['transitions']:,}" if row["episodes"] is None else f"{row['episodes']} episodes"


@app.command()
def status(
    suite: SuiteArgument = options.DEFAULT_SUITE,
    tasks: options.Tasks = None,
    protocol: options.ProtocolName = "auto",
    source: options.Source = "auto",
    as_json: options.Json = False,
) -> None:
    """What each task of a suite needs and how much of it is in the cache.

    Example: lfobench data status locomotion --protocol paper
    """
    from rich.markup import escape
    from rich.table import Table

    from lfobench.cli.options import suite_and_tasks
    from lfobench.data.requested import requested_data

    requested = requested_data(*suite_and_tasks(suite, tasks), protocol, source)
    rows = requested.rows()
    if as_json:
        print_json(rows)
        return
    table = Table("task", "part", "amount", "shards there", title="Data in the cache", title_style="bold")
    for row in rows:
        there = f"{row['shards_present']}/{row['shards']}"
        table.add_row(escape(row["task"]), row["part"], _amount(row), there)
    output.print(table)
    output.print(f"in {escape(str(requested.cache))}", soft_wrap=True)
