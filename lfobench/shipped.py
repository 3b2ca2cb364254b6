"""The packages ``methods`` and ``suites`` of the wheel, importable whatever else has their names.

A script's own folder ``methods/`` comes first on Python's path and would hide the wheel's. With this finder the names
mean the wheel's packages, and modules of the user's folders stay importable: ``methods.dilo`` is always the built-in
one, ``methods.mine`` the user's.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType

HOME = Path(__file__).resolve().parent.parent
PACKAGES = ("methods", "suites")


class _ShippedFirst:
    """Finds the packages next to lfobench, whose `__path__` goes on with equally named folders on Python's path."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in PACKAGES or not (HOME / fullname / "__init__.py").is_file():
            return None
        start = HOME / fullname / "__init__.py"
        return spec_from_file_location(fullname, start, submodule_search_locations=_folders(fullname))


def _folders(name: str) -> list[str]:
    """The package's own folder, then those of its name on Python's path."""
    others = (Path(entry or ".").resolve() / name for entry in sys.path)
    return list(dict.fromkeys(str(folder) for folder in (HOME / name, *others) if folder.is_dir()))


def put_first() -> None:
    """Install the finder; packages of these names that were imported before get the wheel's folder first."""
    if not any(isinstance(finder, _ShippedFirst) for finder in sys.meta_path):
        sys.meta_path.insert(0, _ShippedFirst())
    for name in PACKAGES:
        if (module := sys.modules.get(name)) is not None:
            module.__path__ = list(dict.fromkeys([*_folders(name), *getattr(module, "__path__", [])]))
