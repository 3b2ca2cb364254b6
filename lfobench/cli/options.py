"""Options that commands share, with one meaning each, and requests and selections made of them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from lfobench.cli.console import errors, one_line

if TYPE_CHECKING:
    from pathlib import Path

    from lfobench.cells.cell import Assigned
    from lfobench.cells.plan import Request
    from lfobench.record import Warning
    from lfobench.registry import Suites
    from lfobench.selection import Selection

Methods = Annotated[
    str,
    typer.Option(
        help="Comma-separated methods, e.g. dilo,smodice, or where one stands: file.py, file.py:Class, "
        "package.module:Class. See 'lfobench ls methods'."
    ),
]
SuiteName = Annotated[str, typer.Option("--suite", help="A suite's name, or the path of a file that defines SUITE.")]
Tasks = Annotated[str | None, typer.Option(help="Comma-separated globs over the suite's tasks, e.g. 'hopper-*'.")]
Seeds = Annotated[str | None, typer.Option(help="Numbers and ranges, e.g. 0-6. Default: the protocol's.")]
ProtocolName = Annotated[
    str, typer.Option("--protocol", help="paper, quick, demo, smoke, or auto: paper on a CUDA device, quick on a CPU.")
]
Steps = Annotated[int | None, typer.Option(min=1, help="Gradient steps, in place of the protocol's own number.")]
EvaluationEvery = Annotated[
    int | None, typer.Option("--evaluation-every", min=1, help="Steps between evaluations, in place of the protocol's.")
]
EvaluationEpisodes = Annotated[
    int | None, typer.Option("--evaluation-episodes", min=1, help="Episodes of every evaluation, likewise.")
]
FinalEpisodes = Annotated[
    int | None,
    typer.Option("--final-episodes", min=0, help="Episodes from further starts, run by the trained policy alone."),
]
Preset = Annotated[str, typer.Option(help="released (the authors' code) or paper (what the paper says).")]
Assignments = Annotated[
    list[str] | None, typer.Option("--set", help="METHOD.FIELD=VALUE, repeatable, e.g. --set dilo.tau=3.")
]
Tuned = Annotated[
    bool, typer.Option("--tuned", help="With the values that 'lfobench tune' chose, where there is a choice.")
]
Grid = Annotated[
    list[str] | None,
    typer.Option(
        "--grid",
        help="METHOD.FIELD=V1,V2,…, repeatable: the values to choose from, in place of a declared grid; fields of one "
        "method multiply. E.g. --grid dilo.tau=0.1,1.",
    ),
]
Workers = Annotated[
    int | None, typer.Option(min=1, help="Jobs at once. Default: what the cores, or the device's memory, hold.")
]
NoWait = Annotated[
    bool,
    typer.Option(
        "--no-wait", help="Do not wait for runs that another process is training; exit code 3 where some are left."
    ),
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Print the plan and stop.")]
Source = Annotated[
    str,
    typer.Option(
        help="Where data comes from: generated, a source that the suite declares (d4rl, minari, …), or files of yours, "
        "offline=PATH,expert=PATH and keys=A+B for what an observation is made of. auto: generated where a suite can."
    ),
]
Device = Annotated[str, typer.Option(help="auto, cpu or cuda.")]
Precision = Annotated[
    str,
    typer.Option(
        help="Of matrix products: float32, tf32 (CUDA), bf16, or auto: tf32 on a CUDA device, float32 on a CPU."
    ),
]
Out = Annotated[Path, typer.Option(help="Folder of the records.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for scripts.")]

DEFAULT_METHODS = "dilo,smodice,oril,bco,bc"
DEFAULT_SUITE = "locomotion"
DEFAULT_OUT = Path("runs")


def request(
    methods: str,
    suite: str,
    tasks: str | None,
    seeds: str | None,
    protocol: str,
    preset: str,
    assign: list[str] | None,
    source: str,
    device: str,
    assigned: Assigned,
    precision: str,
    grid: list[str] | None = None,
) -> Request:
    """The options that ``run`` and ``why`` share, as one value."""
    from lfobench.cells.plan import Request

    return Request(
        methods,
        suite,
        tasks,
        seeds,
        protocol,
        preset,
        tuple(assign or ()),
        source,
        device,
        assigned,
        precision,
        tuple(grid or ()),
    )


def choices_in(out: Path, tuned: bool, grid: list[str] | None) -> Path | None:
    """Folder of the choices that ``--tuned`` takes; None without it.

    Raises:
        UserError: ``--grid`` without ``--tuned``.
    """
    from lfobench.errors import UserError

    if grid and not tuned:
        raise UserError("--grid says which choice --tuned takes.", "Add --tuned, or choose with 'lfobench tune'.")
    return out if tuned else None


def registered_suites() -> Suites:
    """The registered suites; a warning is printed for each that is broken."""
    from lfobench.registry import load_suites

    found = load_suites()
    warn(found.broken)
    return found


def suite_and_tasks(name: str, tasks: str | None) -> tuple[str, str | None]:
    """A suite and the globs of its tasks, where the name may also be that of a task of a registered suite.

    Raises:
        UserError: an unknown name, or globs beside a single task.
    """
    from lfobench.errors import UserError, unknown_name
    from lfobench.registry import suite_names

    if name.endswith(".py") or name in suite_names():
        return name, tasks
    owners = registered_suites().owners
    if name not in owners:
        raise unknown_name("suite or task", name, [*suite_names(), *owners])
    if tasks is not None:
        raise UserError(f"--tasks chooses from a suite, and {name} is one task.", "Leave out one of the two.")
    return owners[name], name


def warn(found: Iterable[Warning]) -> None:
    """Print warnings on standard error."""
    for warning in found:
        errors.print(f"[yellow]Warning:[/] {one_line(f'{warning.what} {warning.remedy}')}", soft_wrap=True)


@contextmanager
def printed_warnings() -> Iterator[None]:
    """Warnings of the Python API, printed on standard error as the command line's own."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        try:
            yield
        finally:
            for each in dict.fromkeys(str(warning.message) for warning in caught):
                errors.print(f"[yellow]Warning:[/] {one_line(each)}", soft_wrap=True)


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
StartsName = Annotated[
    str,
    typer.Option("--starts", help="Fixed test starts that count: all, or published, those that a paper has."),
]
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
    starts: str = "all",
) -> Selection:
    """The records of a folder that pass the filters; warnings of the folder are printed.

    Raises:
        UserError: as the API, or for unknown starts.
    """
    from lfobench import selection
    from lfobench.errors import unknown_name

    if starts not in get_args(selection.CountedStarts):
        raise unknown_name("starts", starts, get_args(selection.CountedStarts))
    found = selection.select_records(
        out,
        suite=suite,
        protocol=protocol,
        steps=steps,
        source=source,
        preset=preset,
        methods=methods,
        starts=cast("selection.CountedStarts", starts),
    )
    warn(found.warnings)
    return found
