"""What several commands begin with: options to a request, the registered suites, and warnings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from lfobench.cli.console import errors, one_line

if TYPE_CHECKING:
    from pathlib import Path

    from lfobench.cells.plan import Request
    from lfobench.record import Warning
    from lfobench.registry import Suites


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
        steps,
        precision,
        tuple(grid or ()),
    )


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


def warn(warnings: Iterable[Warning]) -> None:
    """Print warnings on standard error."""
    for warning in warnings:
        errors.print(f"[yellow]Warning:[/] {one_line(f'{warning.what} {warning.remedy}')}", soft_wrap=True)
