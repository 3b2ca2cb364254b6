"""The packages that ship beside lfobench, ``methods`` and ``suites``, found whatever else has their names.

A script's own folder ``methods/`` lies first on Python's path and would take the place of ours. Here the names mean
ours, and the modules of the user's folders stay importable under them: ``methods.dilo`` is always the one that ships,
``methods.mine`` the user's.
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
    """Finds the packages next to lfobench, with the folders of their names on the path behind them."""

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
    """Let the names mean our packages from now on, also where the user's were imported before."""
    if not any(isinstance(finder, _ShippedFirst) for finder in sys.meta_path):
        sys.meta_path.insert(0, _ShippedFirst())
    for name in PACKAGES:
        if (module := sys.modules.get(name)) is not None:
            module.__path__ = list(dict.fromkeys([*_folders(name), *getattr(module, "__path__", [])]))
