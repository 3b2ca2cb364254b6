"""Python files given by path, suites or methods, as modules that can import other files of their folder.

Its folder becomes a package whose name is its path, ``file:/home/me/work``, so that every process can find the module
again by its name alone: classes of such a file can be pickled. In the file and in its neighbours, ``import other`` and
``from other import …`` mean ``other.py`` of their own folder, as in a script. Nowhere else do they: two folders may
each have a ``utils.py``, and neither hides another package of the process.

Names of the standard library, of lfobench and of every package that registers something with it (``methods``,
``suites``) stay theirs. A neighbour is also found by its plain name where a library imports it, as Gymnasium does for
``other:Name-v0``, as long as nothing else has that name.
"""

from __future__ import annotations

import builtins
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.metadata import entry_points
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any
from urllib.parse import unquote

from lfobench.errors import UserError, cause

PREFIX = "file:"


def load_file(path: Path, what: str) -> ModuleType:
    """The module of a Python file; the same one at every call.

    Args:
        path: of the file.
        what: kind of file, e.g. ``suite``, for messages.

    Raises:
        UserError: there is no such file, or running it fails.
    """
    try:
        place = path.expanduser().resolve()
        there = place.is_file()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, no home folder, a null byte
        raise UserError(f"The {what} file {path} cannot be opened: {error}.") from error
    if not there:
        raise UserError(f"No {what} file at {path}.", f"Give the path of a Python file that defines a {what}.")
    package = _package(place.parent)
    if package not in sys.modules:
        # A plain name that meant another folder's file may now mean two.
        for name in [name for name, module in sys.modules.items() if _is_alias(name, module)]:
            del sys.modules[name]
    try:
        return import_module(f"{package}.{_quoted(place.stem)}")
    except (Exception, SystemExit) as error:
        raise UserError(f"The {what} file {path} cannot be run: {cause(error)}.", "Fix the file.") from error


def forget(path: Path) -> None:
    """Unload a file and its neighbours, so that the next `load_file` reads them again."""
    package = _package(path.expanduser().resolve().parent)
    for name, module in list(sys.modules.items()):
        if name == package or name.startswith(f"{package}.") or _is_alias(name, module):
            del sys.modules[name]


def _quoted(text: str) -> str:
    """Text without a dot, which would end a package's name."""
    return text.replace("%", "%25").replace(".", "%2E")


def _package(folder: Path) -> str:
    return f"{PREFIX}{_quoted(str(folder))}"


def _folder(package: str) -> Path:
    return Path(unquote(package.removeprefix(PREFIX)))


@cache
def _others() -> frozenset[str]:
    """Top-level names that are never a neighbour's."""
    points = entry_points()
    groups = [group for group in points.groups if group.startswith("lfobench.")]
    registered = {point.module.partition(".")[0] for group in groups for point in points.select(group=group)}
    return frozenset({"lfobench", *registered, *sys.stdlib_module_names})


def _is_neighbour(folder: Path, name: str) -> bool:
    """Whether a top-level name is a file or package of the folder; a mere folder yields to a package elsewhere."""
    if name in _others():
        return False
    place = folder / name
    if place.with_name(f"{name}.py").is_file() or (place / "__init__.py").is_file():
        return True
    return place.is_dir() and PathFinder.find_spec(name) is None


class _SourceLoader(SourceFileLoader):
    """Runs a file's source, with no stale bytecode in between and imports that look into its folder first."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        code: CodeType = self.source_to_code(self.get_data(path), path)
        return code

    def exec_module(self, module: ModuleType) -> None:
        package = module.__name__.partition(".")[0]
        folder = _folder(package)

        def import_here(
            name: str,
            variables: Mapping[str, Any] | None = None,
            local: Mapping[str, Any] | None = None,
            fromlist: Sequence[str] | None = (),
            level: int = 0,
        ) -> ModuleType:
            top = name.partition(".")[0]
            if level or not _is_neighbour(folder, top):
                return builtins.__import__(name, variables, local, fromlist, level)
            found = builtins.__import__(f"{package}.{name}", variables, local, fromlist or ("__name__",), 0)
            return found if fromlist else sys.modules[f"{package}.{top}"]

        # The import statement calls the `__import__` among the builtins of its own module.
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": import_here}
        super().exec_module(module)


class _AliasLoader(Loader):
    """Another name for a neighbour."""

    def __init__(self, name: str) -> None:
        self.name = name

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(self.name)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec  # which the import system replaced by the alias's


class _ByPath(MetaPathFinder):
    """Finds files by the names that this module gives them."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if not fullname.startswith(PREFIX):
            return None
        package, _, below = fullname.rpartition(".")
        if not package:
            return _folder_spec(below, _folder(below))
        return _spec(fullname, Path(next(iter(path or ()))) / unquote(below))


class _ByPlainName(MetaPathFinder):
    """Finds the neighbours of files that were loaded, where nothing else has their name."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if "." in fullname:
            return None
        packages = [name for name in list(sys.modules) if name.startswith(PREFIX) and "." not in name]
        found = [name for name in packages if _is_neighbour(_folder(name), fullname)]
        if len(found) > 1:
            places = " and ".join(str(_folder(name)) for name in found)
            raise ImportError(f"'{fullname}' is in {places}; rename all but one of them")
        return ModuleSpec(fullname, _AliasLoader(f"{found[0]}.{fullname}")) if found else None


def _spec(name: str, place: Path) -> ModuleSpec | None:
    for file, within in ((place / "__init__.py", [str(place)]), (place.with_name(f"{place.name}.py"), None)):
        if file.is_file():
            loader = _SourceLoader(name, str(file))
            return spec_from_file_location(name, file, loader=loader, submodule_search_locations=within)
    return _folder_spec(name, place) if place.is_dir() else None


def _folder_spec(name: str, folder: Path) -> ModuleSpec:
    spec = ModuleSpec(name, None, is_package=True)
    spec.submodule_search_locations = [str(folder)]
    return spec


def _is_alias(name: str, module: ModuleType) -> bool:
    return not name.startswith(PREFIX) and getattr(module, "__name__", "").startswith(PREFIX)


# The first precedes Python's own finders, which would find ordinary modules; the second comes after them.
sys.meta_path.insert(0, _ByPath())
sys.meta_path.append(_ByPlainName())
