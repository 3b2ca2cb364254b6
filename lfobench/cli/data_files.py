"""``lfobench data download | verify | rm``: the files of a suite's sources, brought, checked and forgotten."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lfobench.cli import options
from lfobench.cli.console import INTERRUPTED, errors, one_line, output
from lfobench.text import counted

if TYPE_CHECKING:
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

    LFOBENCH_MIRROR names folders on other hosts that are asked first.

    Example: lfobench data download locomotion --source d4rl --tasks 'hopper-*'
    """
    from rich.markup import escape

    from lfobench.cli.inputs import suite_and_tasks
    from lfobench.cli.progress import display
    from lfobench.data.library import adopt, bring
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
                note = bring(library, each, report) if from_folder is None else adopt(library, each, from_folder)
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
    from lfobench.cli.inputs import suite_and_tasks
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
    from lfobench.cli.inputs import suite_and_tasks
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
    """Of the cache."""
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
