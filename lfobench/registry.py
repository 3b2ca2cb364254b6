"""Methods and suites by name, found through entry points; the built-in ones register the same way.

A third-party package adds methods and suites by entry points in its own ``pyproject.toml``::

    [project.entry-points."lfobench.methods"]
    mine = "my_package.mine:Mine"

A method may also be named by its location, ``path/to/file.py``, ``path/to/file.py:Mine`` or ``my_package.mine:Mine``,
and a suite by the path of its file. A broken method or suite is an error only where it is asked for.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic import ValidationError

from lfobench.contract.method import Method, MethodConfig, budget_fields
from lfobench.contract.suite import Suite
from lfobench.errors import UserError, cause, unknown_name
from lfobench.python_files import forget, load_file
from lfobench.record import Warning
from lfobench.shipped import is_shipped, put_first, replaced
from lfobench.source_code import code_of, edited_since, ships

METHODS = "lfobench.methods"
SUITES = "lfobench.suites"

NAME = r"[A-Za-z0-9_][A-Za-z0-9_+-]*"
"""Pattern of a method's name: without comma, dot and colon, which are syntax where methods are named."""

_IN_FILE = re.compile(r"(?P<file>.*\.py)(:(?P<name>\w+))?", re.DOTALL)
_IN_MODULE = re.compile(r"(?P<module>[\w.]+):(?P<name>\w+)")

_given: dict[str, type[Method]] = {}
"""Methods that were named by location, by their own names, as records and assignments have them."""


@cache
def _points(group: str) -> dict[str, list[EntryPoint]]:
    """Registrations by name; a name with several is ambiguous."""
    found: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=group):
        others = found.setdefault(point.name, [])
        if all(other.value != point.value for other in others):
            others.append(point)
    if not found:
        raise UserError(f"Nothing is registered in {group}.", "Install the project: pip install -e .")
    return found


def method_names() -> list[str]:
    """Every registered method."""
    return sorted(_points(METHODS))


def suite_names() -> list[str]:
    """Every registered suite."""
    return sorted(_points(SUITES))


def is_place(name: str) -> bool:
    """Whether a method's name is a location."""
    return bool(_IN_FILE.fullmatch(name) or _IN_MODULE.fullmatch(name))


def load_method(name: str) -> type[Method]:
    """The class of a method's name or location.

    Args:
        name: registered; or ``file.py``, ``file.py:Class`` or ``package.module:Class``; or the own name of a method
            that this process has loaded from such a location.

    Raises:
        UserError: for an unknown name, a failing import, or a class that is no complete method.
    """
    if place := _IN_FILE.fullmatch(name):
        return give_method(_in_file(Path(place["file"]), place["name"]), name)
    if place := _IN_MODULE.fullmatch(name):
        return give_method(_attribute(_imported(place["module"], name), place["name"], name), name)
    points = _points(METHODS)
    if name in points:
        return _registered_method(name)
    if name in _given:
        return _given[name]
    raise unknown_name("method", name, {*points, *_given})


def give_method(method: object, where: str) -> type[Method]:
    """The class of a method that was named by location, checked; from now on its own name finds it.

    Raises:
        UserError: it is no complete method, or has the name of a registered one.
    """
    checked = checked_method(method, where)
    _check_not_replaced(checked.__module__, f"Method {where}")
    if checked.name in _points(METHODS):
        registered = _registered_method(checked.name)
        if registered is checked:
            return checked
        if ships(registered) or code_of(registered) != code_of(checked):
            raise UserError(
                f"Method {where} has the name '{checked.name}', which is a registered method's.", "Name it otherwise."
            )
    _given[checked.name] = checked
    return checked


def package_of(method: type[Method]) -> dict[str, str]:
    """The installed package that registers a method, to its version; empty for built-in and unregistered ones."""
    places = [] if ships(method) else _points(METHODS).get(method.name, [])
    here = f"{method.__module__}:{method.__qualname__}"
    return {place.dist.name: place.dist.version for place in places if place.dist is not None and place.value == here}


@cache
def _registered_method(name: str) -> type[Method]:
    point = _only(METHODS, "method", name)
    return checked_method(_load(point), f"'{name}' ({point.value})", name)


def checked_method(method: object, where: str, registered: str | None = None) -> type[Method]:
    """`method`, checked to be usable.

    Args:
        method: any object.
        where: its location, for messages.
        registered: its name in the registry.

    Raises:
        UserError: with all that is missing.
    """
    if not (isinstance(method, type) and issubclass(method, Method)):
        raise UserError(
            f"Method {where} is not a lfobench Method class.", "Derive it from lfobench.contract.method.Method."
        )
    faults = declaration_faults(method)
    if registered is not None and isinstance(getattr(method, "name", None), str) and method.name != registered:
        faults.append(f"it calls itself '{method.name}'")
    if faults:
        raise UserError(f"Method {where} cannot be used: {'; '.join(faults)}.", "Fix the class.")
    return method


def declaration_faults(method: type[Method]) -> list[str]:
    """Faults in the declarations of a method, as text."""
    faults = []
    if missing := sorted(method.__abstractmethods__):
        faults.append(f"it lacks {', '.join(missing)}")
    name: object = getattr(method, "name", None)
    if name is None:
        faults.append("it has no name")
    elif not isinstance(name, str) or not re.fullmatch(NAME, name):
        faults.append(f"its name is {name!r}; letters, digits, '_', '+' and '-' make a name")
    if not isinstance(method.version, int) or isinstance(method.version, bool):
        faults.append(f"its version is {method.version!r}, not a whole number")
    sees_actions: object = method.access_to_expert_actions
    if not isinstance(sees_actions, bool):
        faults.append("its access_to_expert_actions is neither True nor False")
    config: object = getattr(method, "Config", None)
    if not (isinstance(config, type) and issubclass(config, MethodConfig)):
        return [*faults, "it has no Config" if config is None else "its Config is not a MethodConfig"]
    if not _is_texts(method.stated):
        faults.append("its stated is not a tuple of names of fields")
    else:
        unknown = [field for field in method.stated if field not in config.model_fields]
        faults += [f"it states '{field}', which its Config lacks" for field in unknown]
    if not _is_named(
        method.grids, lambda values: isinstance(values, Sequence) and not isinstance(values, (str, bytes))
    ):
        faults.append("its grids are not a mapping of fields to tuples of values")
    tables = {"presets": method.presets, "budgets": method.budgets}
    wrong = [kind for kind, table in tables.items() if not _is_named(table, _is_named)]
    faults += [f"its {kind} are not a mapping of names to mappings of fields" for kind in wrong]
    return (
        faults
        if wrong
        else faults
        + _unfit(
            config, method.presets, {protocol: budget_fields(fields, 1) for protocol, fields in method.budgets.items()}
        )
    )


def _unfit(
    config: type[MethodConfig], presets: Mapping[str, Mapping[str, Any]], budgets: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """Presets and budgets that are no valid configuration, each alone, or else combined."""
    alone = {
        **{f"its preset '{preset}'": fields for preset, fields in presets.items()},
        **{f"its budget '{budget}'": fields for budget, fields in budgets.items()},
    }
    together = {
        f"its preset '{preset}' under its budget '{budget}'": {**fields, **changed}
        for preset, fields in presets.items()
        for budget, changed in budgets.items()
    }
    for group in (alone, together):
        faults = []
        for which, fields in group.items():
            try:
                config.model_validate(dict(fields))
            except ValidationError as error:
                first = error.errors()[0]
                place = ".".join(map(str, first["loc"]))
                faults.append(f"{which} does not fit its Config ({place}: {first['msg'].lower()})")
            except Exception as error:  # a validator of the Config is third-party code
                faults.append(f"{which} does not fit its Config ({cause(error)})")
        if faults:
            return faults
    return []


def _is_texts(value: object) -> bool:
    return (
        isinstance(value, Collection)
        and not isinstance(value, (str, bytes))
        and all(isinstance(one, str) for one in value)
    )


def _is_named(value: object, holds: Callable[[Any], bool] = lambda _: True) -> bool:
    """Whether a value is a mapping from names to what `holds` accepts."""
    return isinstance(value, Mapping) and all(isinstance(name, str) and holds(one) for name, one in value.items())


def _in_file(path: Path, name: str | None) -> object:
    """The method that a file defines, or the one of that class name; read again if the file was edited since."""
    found = _method_of(load_file(path, "method"), path, name)
    if isinstance(found, type) and issubclass(found, Method) and edited_since(found):
        forget(path)
        found = _method_of(load_file(path, "method"), path, name)
    return found


def _method_of(module: ModuleType, path: Path, name: str | None) -> object:
    if name is not None:
        return _attribute(module, name, str(path))
    own = [
        each
        for each in vars(module).values()
        if isinstance(each, type) and issubclass(each, Method) and each.__module__ == module.__name__
    ]
    own = [each for each in own if not inspect.isabstract(each)] or own
    if not own:
        raise UserError(
            f"The method file {path} defines no Method.", "Derive a class from lfobench.contract.method.Method."
        )
    if len(own) > 1:
        names = [each.__name__ for each in own]
        raise UserError(f"The method file {path} defines {', '.join(names)}.", f"Say which: {path}:{names[0]}")
    return own[0]


def _attribute(module: ModuleType, name: str, where: str) -> object:
    found: object = getattr(module, name, None)
    if found is None:
        raise UserError(f"There is no class '{name}' in {where}.", "Name a Method class of that file or module.")
    return found


def _imported(module: str, where: str) -> ModuleType:
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)  # last, so that no folder there hides an installed package
        put_first()  # so that its folder methods/ is found, too
    try:
        return import_module(module)
    except (Exception, SystemExit) as error:
        raise UserError(f"Method {where} cannot be imported: {cause(error)}.", "Install or fix its package.") from error


@cache
def load_suite(name: str) -> Suite:
    """The suite of a name, or of the path of a Python file that defines ``SUITE``.

    Raises:
        UserError: for an unknown name, or a suite that cannot be imported.
    """
    if name.endswith(".py"):
        return _suite_file(Path(name))
    point = _only(SUITES, "suite", name)
    loaded = _load(point)
    if not isinstance(loaded, Suite):
        raise UserError(f"Suite '{name}' ({point.value}) is not a lfobench Suite.")
    return loaded


@dataclass(frozen=True)
class Suites:
    """The registered suites.

    Attributes:
        loaded: by name.
        broken: one warning for each that cannot be loaded.
    """

    loaded: dict[str, Suite]
    broken: list[Warning]

    @property
    def owners(self) -> dict[str, str]:
        """Every task to the name of its suite, the first where several have it."""
        return {task.name: name for name in reversed(self.loaded) for task in self.loaded[name].tasks}


def load_suites(among: Collection[str] | None = None) -> Suites:
    """The registered suites that can be loaded, in order of name; all, or those `among` which are registered."""
    found = Suites({}, [])
    for name in suite_names() if among is None else sorted({*among} & _points(SUITES).keys()):
        try:
            found.loaded[name] = load_suite(name)
        except UserError as error:
            found.broken.append(Warning(what=error.problem, remedy=error.remedy))
    return found


def _only(group: str, kind: str, name: str) -> EntryPoint:
    """The one registration of a name."""
    points = _points(group)
    if name not in points:
        raise unknown_name(kind, name, points)
    point, *others = points[name]
    if others:
        values = " and ".join(each.value for each in points[name])
        raise UserError(f"The {kind} '{name}' is registered twice: {values}.", "Uninstall one of the two packages.")
    return point


def _check_not_replaced(module: str, where: str) -> None:
    """Refuse to guess where a program imported a file of its own by the name of one of ours.

    Raises:
        UserError: naming the file.
    """
    others = replaced(module.partition(".")[0]) if is_shipped(module) else {}
    for name, file in others.items():
        raise UserError(
            f"{where} cannot be used: {name} is a module of lfobench, and this program imported {file} by that name.",
            "Rename the file.",
        )


def _load(point: EntryPoint) -> object:
    _check_not_replaced(point.module, f"'{point.name}' ({point.value})")
    try:
        loaded: object = point.load()
    except (Exception, SystemExit) as error:
        raise UserError(
            f"'{point.name}' ({point.value}) cannot be imported: {cause(error)}.",
            "Reinstall or fix the package that registers it.",
        ) from error
    return loaded


def _suite_file(path: Path) -> Suite:
    suite = getattr(load_file(path, "suite"), "SUITE", None)
    if not isinstance(suite, Suite):
        raise UserError(f"The suite file {path} defines no SUITE.", "Assign a lfobench Suite to SUITE.")
    return suite
