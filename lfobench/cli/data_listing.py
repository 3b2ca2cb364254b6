"""``lfobench data ls``: what files there are to be had, and which are here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lfobench.cli import options
from lfobench.cli.console import one_line, output, print_json
from lfobench.cli.data_files import AnySource, library_here, wanted_of

if TYPE_CHECKING:
    from lfobench.contract.suite import DataFile
    from lfobench.data.library import Library, Wanted


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

    from lfobench.cli.inputs import suite_and_tasks

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
    from lfobench.cli.inputs import registered_suites
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
