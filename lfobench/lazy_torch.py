"""A stand-in for torch until something of it is used, so that commands which only read do not wait for it.

Methods import torch at the top of their files, as they should; listing them, planning runs and drawing tables need
nothing of it, and it takes longer to load than all of those to run. The stand-in is installed by the command line for
such commands alone; what trains loads torch itself.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

NAME = "torch"


class _StandIn(ModuleType):
    """Loads torch when an attribute is first asked for, and has all of its attributes from then on."""

    def __getattr__(self, name: str) -> Any:
        return getattr(_load(), name)


class _Loaded:
    """A module that is there already."""

    def __init__(self, module: ModuleType) -> None:
        self._module, self._spec = module, module.__spec__

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return self._module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec  # which the import system has replaced


class _Submodules:
    """Finds parts of torch that came with it: ``import torch.nn`` asks for its place only after that loaded it."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if not fullname.startswith(f"{NAME}.") or (module := sys.modules.get(fullname)) is None:
            return None
        return ModuleSpec(fullname, _Loaded(module))  # type: ignore[arg-type]  # importlib.abc takes long to import


def install() -> None:
    """Let ``import torch`` cost nothing until torch is used; no effect where it is loaded."""
    if NAME not in sys.modules and (spec := PathFinder.find_spec(NAME)) is not None:
        sys.modules[NAME] = _StandIn(NAME)
        sys.modules[NAME].__spec__ = spec  # for libraries that ask whether torch is installed
        sys.meta_path.insert(0, _Submodules())


def is_loaded() -> bool:
    """Whether torch itself is loaded."""
    return NAME in sys.modules and not isinstance(sys.modules[NAME], _StandIn)


def _load() -> ModuleType:
    stand_in = sys.modules.get(NAME)
    if not isinstance(stand_in, _StandIn):
        return importlib.import_module(NAME)
    del sys.modules[NAME]
    try:
        torch = importlib.import_module(NAME)
    except BaseException:
        sys.modules[NAME] = stand_in
        raise
    vars(stand_in).update({name: value for name, value in vars(torch).items() if name != "__spec__"})
    return torch
