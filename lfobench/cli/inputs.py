"""What several commands begin with: options to a plan, a folder to its records."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from lfobench.cli.console import errors, one_line

if TYPE_CHECKING:
    from pathlib import Path

    from lfobench.contract.record import Warning
    from lfobench.plan.planning import Plan, Request
    from lfobench.registry import Suites
    from lfobench.store.folder import RecordsRead


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
    steps: int | None,
    precision: str,
    grid: list[str] | None = None,
) -> Request:
    """The options that ``run`` and ``why`` share, as one value."""
    from lfobench.plan.planning import Request

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
        steps,
        precision,
        tuple(grid or ()),
    )


def resolve(wanted: Request, tuned_in: Path | None = None) -> Plan:
    """Names to cells, with the values chosen in the output folder `tuned_in` where one is given.

    Torch is asked for CUDA only where it matters.
    """
    import torch

    from lfobench.data.library import Library
    from lfobench.files import cache_folder
    from lfobench.plan.planning import make_plan
    from lfobench.store.tuning import TuningFolder, with_choices

    plan = make_plan(wanted, torch.cuda.is_available, Library(cache_folder()).find)
    return plan if tuned_in is None else with_choices(plan, wanted, TuningFolder(tuned_in))


def choices_in(out: Path, tuned: bool, grid: list[str] | None) -> Path | None:
    """Where the choices lie that ``--tuned`` takes; None without it.

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


def read_folder(out: Path) -> RecordsRead:
    """The records of an output folder; none where it does not exist yet."""
    from lfobench.errors import UserError
    from lfobench.store.folder import RecordFolder, RecordsRead

    try:
        absent = not out.exists()
    except OSError as error:
        raise UserError(f"Cannot look into {out}: {error.strerror}.", "Choose another --out.") from error
    return RecordsRead() if absent else RecordFolder(out).read_all()


def warn(warnings: Iterable[Warning]) -> None:
    """Print warnings on standard error."""
    for warning in warnings:
        errors.print(f"[yellow]Warning:[/] {one_line(f'{warning.what} {warning.remedy}')}", soft_wrap=True)
