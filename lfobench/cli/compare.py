"""``lfobench compare``: two methods of one folder, or two folders as a regression gate."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lfobench.cli import options, selection
from lfobench.cli.console import output
from lfobench.cli.inputs import warn

if TYPE_CHECKING:
    from lfobench.api import Selection

Correction = Annotated[
    str,
    typer.Option(
        help="For the number of cells compared: none, holm or bh. Holm, because a gate over many cells would otherwise "
        "raise false alarms."
    ),
]


def compare(
    first: Annotated[str, typer.Argument(metavar="A", help="A method among the records of --out, or a folder.")],
    second: Annotated[str, typer.Argument(metavar="B", help="Another method, or the folder to judge against A.")],
    out: options.Out = options.DEFAULT_OUT,
    allow: Annotated[
        list[str] | None,
        typer.Option(help="Condition in which two folders may differ, e.g. simulator or protocol.steps; repeatable."),
    ] = None,
    statistic: selection.StatisticName = None,
    test: selection.TestName = None,
    correction: Correction = "holm",
    alpha: selection.Alpha = 0.05,
    suite: selection.SuiteFilter = None,
    protocol: selection.ProtocolFilter = None,
    steps: selection.StepsFilter = None,
    source: selection.SourceFilter = None,
    preset: selection.PresetFilter = None,
    as_json: options.Json = False,
) -> None:
    """Better, worse or undecided, task by task: method A against B, or folder B against A.

    Two folders are a regression gate: exit code 1 says that B is worse on some cell.

    Versions and configurations of two folders may differ, and are listed; conditions only with --allow.

    A cell that only A has cannot be judged: it is a warning.

    Example: lfobench compare dilo smodice --out runs

    Example: lfobench compare runs-before runs-after --json
    """
    from lfobench.analyses.compare import Side, pair_folders, pair_methods, warnings_of
    from lfobench.analyses.compare import compare as judge
    from lfobench.analyses.compare_formats import json_contrast, terminal
    from lfobench.errors import UserError
    from lfobench.tables.counting import knobs

    filters = (suite, protocol, steps, source, preset)
    folders = _are_folders(first, second)
    if allow and not folders:
        raise UserError(
            "--allow is for two folders: methods of one folder are compared under the same conditions.",
            "Leave it out, or put their records into two folders.",
        )
    selected = [_selected(Path(name), filters) for name in ((first, second) if folders else (out,))]
    scored, rule = knobs(
        [each for found in selected for each in found.records], statistic, test, "all", correction, alpha
    )
    if folders:
        reference, subject = (
            Side(name, heading, found.records, found.failures)
            for name, heading, found in zip((first, second), "AB", selected, strict=True)
        )
        tasks = list(dict.fromkeys(task for found in selected for task in found.tasks))
        pairing = pair_folders(reference, subject, scored, tasks, allow or [], rule)
    else:
        (found,) = selected
        pairing = pair_methods(found.records, found.failures, first, second, scored, found.tasks, rule)
    compared = judge(pairing, rule, scored)
    warn(warnings_of(compared))
    if as_json:
        output.out(json_contrast(compared), end="", highlight=False)
    else:
        output.print(terminal(compared))
    if compared.regressed:
        raise typer.Exit(1)


_Filters = tuple[str | None, str | None, int | None, str | None, str | None]


def _are_folders(first: str, second: str) -> bool:
    """Whether both names are folders; refuses one folder, and what can only be a folder and is not there."""
    from lfobench.errors import UserError

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


def _selected(out: Path, filters: _Filters) -> Selection:
    """The records of a folder, of which there must be some."""
    from lfobench.errors import UserError

    found = selection.select_records(out, *filters)
    if not found.records:
        raise UserError(f"{out} holds no records.", "Run 'lfobench run' first, or name another folder.")
    return found
