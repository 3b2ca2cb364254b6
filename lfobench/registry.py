"""Methods and suites by name, found through entry points; the built-in ones register the same way.

A package of somebody else's appears in the command line by declaring, in its own ``pyproject.toml``::

    [project.entry-points."lfobench.methods"]
    mine = "my_package.mine:Mine"
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from lfobench.contract.method import Method
from lfobench.contract.suite import Suite
from lfobench.errors import UserError, unknown_name
from lfobench.python_files import load_file

METHODS = "lfobench.methods"
SUITES = "lfobench.suites"
BENCHMARKS = "lfobench.benchmarks"


@cache
def _points(group: str) -> dict[str, EntryPoint]:
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        other = found.setdefault(point.name, point)
        if other.value != point.value:
            raise UserError(
                f"'{point.name}' is registered twice in {group}: {other.value} and {point.value}.",
                "Uninstall one of the two packages.",
            )
    if not found:
        raise UserError(f"Nothing is registered in {group}.", "Install the project: pip install -e .")
    return found


def method_names() -> list[str]:
    """Every registered method."""
    return sorted(_points(METHODS))


def suite_names() -> list[str]:
    """Every registered suite."""
    return sorted(_points(SUITES))


@cache
def load_method(name: str) -> type[Method]:
    """The class behind a method's name.

    Raises:
        UserError: for an unknown name, or a registration that cannot be imported.
    """
    points = _points(METHODS)
    if name not in points:
        raise unknown_name("method", name, points)
    loaded = _load(points[name])
    if not (isinstance(loaded, type) and issubclass(loaded, Method)):
        raise UserError(f"Method '{name}' ({points[name].value}) is not a lfobench Method class.")
    return loaded


@cache
def load_suite(name: str) -> Suite:
    """The suite behind a name, or behind the path of a Python file that defines ``SUITE``.

    Raises:
        UserError: for an unknown name, or a suite that cannot be imported.
    """
    if name.endswith(".py"):
        return _suite_file(Path(name))
    points = _points(SUITES)
    if name not in points:
        raise unknown_name("suite", name, points)
    loaded = _load(points[name])
    if not isinstance(loaded, Suite):
        raise UserError(f"Suite '{name}' ({points[name].value}) is not a lfobench Suite.")
    return loaded


def suites_of_tasks() -> dict[str, str]:
    """Every task of a registered suite to that suite's name, the first where several have it.

    Raises:
        UserError: for a suite that cannot be imported.
    """
    names = suite_names()
    return {task.name: name for name in reversed(names) for task in load_suite(name).tasks}


def load_benchmarks(name: str) -> Any:
    """The module behind a set of benchmarks: it has `SECTIONS` and `measure`.

    Raises:
        UserError: for an unknown name, or a registration that cannot be imported.
    """
    points = _points(BENCHMARKS)
    if name not in points:
        raise unknown_name("set of benchmarks", name, points)
    return _load(points[name])


def _load(point: EntryPoint) -> object:
    try:
        loaded: object = point.load()
    except (Exception, SystemExit) as error:
        raise UserError(
            f"'{point.name}' ({point.value}) cannot be imported: {type(error).__name__}: {error}.",
            "Reinstall or mend the package that registers it.",
        ) from error
    return loaded


def _suite_file(path: Path) -> Suite:
    suite = getattr(load_file(path, "suite"), "SUITE", None)
    if not isinstance(suite, Suite):
        raise UserError(f"The suite file {path} defines no SUITE.", "Assign a lfobench Suite to SUITE.")
    return suite
