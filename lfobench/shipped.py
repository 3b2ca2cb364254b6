"""The packages that ship beside lfobench, ``methods`` and ``suites``, found whatever else has their names.

A script's own folder ``methods/`` lies first on Python's path and would take the place of ours. Here the names mean
ours, and the modules of the user's folders stay importable under them: ``methods.dilo`` is always the one that ships,
``methods.mine`` the user's.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType

HOME = Path(__file__).resolve().parent.parent
PACKAGES = ("methods", "suites")


class _ShippedFirst(MetaPathFinder):
    """Finds the packages next to lfobench, with the folders of their names on the path behind them."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in PACKAGES or not (HOME / fullname / "__init__.py").is_file():
            return None
        ours = HOME / fullname
        others = (Path(entry or ".").resolve() / fullname for entry in sys.path)
        folders = dict.fromkeys([str(ours), *(str(folder) for folder in others if folder.is_dir())])
        return spec_from_file_location(fullname, ours / "__init__.py", submodule_search_locations=list(folders))


def put_first() -> None:
    """Let the names mean our packages from now on, also where the user's were imported before."""
    if not any(isinstance(finder, _ShippedFirst) for finder in sys.meta_path):
        sys.meta_path.insert(0, _ShippedFirst())
    for name in PACKAGES:
        ours, module = str(HOME / name), sys.modules.get(name)
        if module is not None and ours not in (folders := list(getattr(module, "__path__", []))):
            module.__path__ = [ours, *folders]
