"""The packages ``methods`` and ``suites`` of the wheel, importable whatever else has their names.

A script's own folder ``methods/`` comes first on Python's path and would hide the wheel's. With this finder the names
mean the wheel's packages, and modules of the user's folders stay importable: ``methods.dilo`` is always the built-in
one, ``methods.mine`` the user's. The user's ``methods/__init__.py`` runs when a name is asked for that the wheel's
lacks.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import find_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

HOME = Path(__file__).resolve().parent.parent
PACKAGES = ("methods", "suites")


class _ShippedFirst:
    """Finds the packages next to lfobench, whose `__path__` goes on with equally named folders on Python's path."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in PACKAGES or not _start(fullname).is_file():
            return None
        loader = _ShippedLoader(fullname, str(_start(fullname)))
        return spec_from_file_location(
            fullname, _start(fullname), loader=loader, submodule_search_locations=_folders(fullname)
        )


class _ShippedLoader(SourceFileLoader):
    """Runs a package of the wheel, whose missing names come from the user's package of the same name."""

    def exec_module(self, module: ModuleType) -> None:
        super().exec_module(module)
        own: list[Path] = []

        def name_of_own(attribute: str) -> Any:
            name = module.__name__
            if not own and not attribute.startswith("__") and find_spec(f"{name}.{attribute}") is None:
                own.extend(start for folder in _folders(name)[1:] if (start := Path(folder) / "__init__.py").is_file())
                if own:
                    # Names of the wheel's package stay what its modules read.
                    shipped = dict(vars(module))
                    SourceFileLoader(name, str(own[0])).exec_module(module)
                    vars(module).update(shipped)
                    if attribute in vars(module):
                        return vars(module)[attribute]
            raise AttributeError(f"module '{name}' has no attribute '{attribute}'")

        vars(module)["__getattr__"] = name_of_own


def _folders(name: str) -> list[str]:
    """The package's own folder, then those of its name on Python's path."""
    found = [str(HOME / name)]
    for entry in sys.path:
        with suppress(OSError):  # a working folder that was deleted, say
            if (folder := Path(entry or ".").resolve() / name).is_dir():
                found.append(str(folder))
    return list(dict.fromkeys(found))


def put_first() -> None:
    """Install the finder; into packages of these names that were imported before, the wheel's come first."""
    if not any(isinstance(finder, _ShippedFirst) for finder in sys.meta_path):
        sys.meta_path.insert(0, _ShippedFirst())
    for name in PACKAGES:
        if (module := sys.modules.get(name)) is None:
            continue
        before = list(getattr(module, "__path__", []))
        module.__path__ = list(dict.fromkeys([*_folders(name), *before]))
        if str(HOME / name) not in before and _start(name).is_file():
            # Another package of this name, which stays the same object: importers of ours find our names in it.
            SourceFileLoader(name, str(_start(name))).exec_module(module)


def is_shipped(module: str) -> bool:
    """Whether a dotted name is one of the wheel's modules, not one of a user's folder ``methods/`` or ``suites/``."""
    top = module.partition(".")[0]
    return top == "lfobench" or (top in PACKAGES and any(file.is_file() for file in _places(module)))


def replaced(package: str) -> dict[str, str]:
    """Modules of a package that ships, by name, in whose place another file was imported before, to that file."""
    found = {}
    for name, module in list(sys.modules.items()):
        if not name.startswith(f"{package}.") or not is_shipped(name):
            continue
        # Last, because asking a module for an attribute may load what it stands for.
        if file := getattr(module, "__file__", None):
            own = [place.resolve() for place in _places(name)]
            if Path(file).resolve() not in own:
                found[name] = str(file)
    return found


def _start(package: str) -> Path:
    return HOME / package / "__init__.py"


def _places(module: str) -> tuple[Path, Path]:
    place = HOME.joinpath(*module.split("."))
    return place / "__init__.py", place.with_name(f"{place.name}.py")
