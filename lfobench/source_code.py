"""Source files of a method that does not ship with lfobench: whoever edits one has another method.

Methods that ship with lfobench are identified by their `version`, which the pinned numbers hold them to.
"""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from pydantic import BaseModel

import lfobench
from lfobench.contract.method import Method
from lfobench.contract.record import content_hash
from lfobench.errors import UserError
from lfobench.python_files import PREFIX

SHIPPED = frozenset({"lfobench", "methods", "suites", "benchmarks"})
"""Top-level packages of this distribution, which no method's folder stands in for."""

SESSION = "<session>"
"""In the place of a file's name: a class that was typed into an interactive session."""

_HOME = Path(lfobench.__file__).resolve().parent.parent


def ships(method: type[Method]) -> bool:
    """Whether a method is one of lfobench's own."""
    return _top(method) == "methods" and (_file(method) or Path()).parent == _HOME / "methods"


def in_session(method: type[Method]) -> bool:
    """Whether no other process can import the class: it is the main program's, or was made inside a function."""
    module = sys.modules.get(method.__module__)
    found: object = module
    for part in method.__qualname__.split("."):
        found = getattr(found, part, None)
    return method.__module__ == "__main__" or found is not method


@cache
def code_of(method: type[Method]) -> dict[str, str]:
    """Files that decide what a method does, by name, to the SHA-256 of their bytes; none for one that ships.

    The file of the class and, over and over, what its files import from their own package or folder. What the class was
    made from is what counts: of one class object, the answer stays.
    """
    if ships(method):
        return {}
    _check_current(method)
    return _read(method)


def check_unchanged(method: type[Method], code: Mapping[str, str]) -> None:
    """Refuse to train, as the method that was planned, what its files have become.

    Raises:
        UserError: naming a file that was edited.
    """
    now = code_of(method)
    changed = sorted(name for name in {*now, *code} if now.get(name) != code.get(name))
    if code and changed:
        raise UserError(
            f"{', '.join(changed)} of method '{method.name}' changed after the plan was made.",
            "Give the command again.",
        )


def edited_since(method: type[Method]) -> bool:
    """Whether the files of a class are no longer those that it was made from."""
    return not ships(method) and _read(method) != code_of(method)


def _read(method: type[Method]) -> dict[str, str]:
    file = _file(method)
    if file is None:
        return {SESSION: content_hash(sorted(set(_typed(method, set()))))}
    root = file.parent
    if not method.__module__.startswith(("__main__", PREFIX)):
        packages = method.__module__.count(".") + (file.name == "__init__.py")
        root = root.parents[packages - 1] if packages else root
    return {name: hashlib.sha256(data).hexdigest() for name, data in sorted(_closure(file, root).items())}


def _top(method: type[Method]) -> str:
    return method.__module__.partition(".")[0]


def _file(method: type[Method]) -> Path | None:
    """Where the class stands; None of one that was typed into a session."""
    named = getattr(sys.modules.get(method.__module__), "__file__", None)
    file = Path(named or "").absolute()
    if not file.is_file():
        return None
    written = {Path(function.__code__.co_filename).absolute() for function in _functions(method)}
    return None if method.__module__ == "__main__" and file not in written else file


def _functions(method: type[Method]) -> list[FunctionType]:
    """Those that stand in the class itself, undecorated."""
    own = [each for each in vars(method).values() if isinstance(each, FunctionType)]
    return [each for each in own if each.__module__ == method.__module__]


def _closure(first: Path, root: Path) -> dict[str, bytes]:
    """By path below `root`, the bytes of a file and of all that it imports from there."""
    own = first.relative_to(root).parts[0].removesuffix(".py")
    alone = root.name in ("site-packages", "dist-packages")
    found: dict[str, bytes] = {}
    waiting = [first, *_files(root, first.parent.relative_to(root).parts)]
    while waiting:
        file = waiting.pop()
        name = file.relative_to(root).as_posix()
        if name in found:
            continue
        found[name] = file.read_bytes()
        for dotted in _imported(found[name], file.relative_to(root)) if file.suffix == ".py" else ():
            top = dotted[0]
            # Among installed packages, a neighbour is somebody else's.
            if top == own or not (alone or top in SHIPPED or top in sys.stdlib_module_names):
                waiting += _files(root, dotted)
    return found


def _imported(source: bytes, place: Path) -> Iterator[tuple[str, ...]]:
    """Dotted names that a file may import, longest first; a name may turn out to be no module."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError):
        return
    package = place.parent.parts
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (tuple(alias.name.split(".")) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - (node.level - 1)] if node.level else ()
            base = (*above, *(node.module.split(".") if node.module else ()))
            yield from ((*base, alias.name) for alias in node.names if base or alias.name != "*")


def _files(root: Path, dotted: tuple[str, ...]) -> Iterator[Path]:
    """Files that importing a dotted name runs: of every package on the way, and of the module itself."""
    for length in range(1, len(dotted) + 1):
        place = root.joinpath(*dotted[:length])
        candidates = [
            place / "__init__.py",
            *(place.with_name(place.name + end) for end in (".py", *EXTENSION_SUFFIXES)),
        ]
        yield from [each for each in candidates if each.is_file()][:1]


def _check_current(method: type[Method]) -> None:
    """Refuse a class that was made before its file was edited: nobody could say what it is.

    Raises:
        UserError: naming the file.
    """
    file = _file(method)
    if file is None or file.suffix != ".py":
        return
    written = set(_codes(compile(file.read_bytes(), str(file), "exec", dont_inherit=True)))
    made = [each.__code__ for each in _functions(method) if Path(each.__code__.co_filename).absolute() == file]
    if any(code not in written for code in made):
        raise UserError(f"{file} was edited after its method '{method.name}' was imported.", "Start Python again.")


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _typed(value: Any, seen: set[int]) -> Iterator[str]:
    """What was typed of a class or function, and of everything else from the session that its code names."""
    if id(value) in seen:
        return
    seen.add(id(value))
    if isinstance(value, (classmethod, staticmethod)):
        yield from _typed(value.__func__, seen)
    elif isinstance(value, property):
        yield from (text for part in (value.fget, value.fset) for text in _typed(part, seen))
    elif isinstance(value, FunctionType) and value.__module__ == "__main__":
        yield f"{value.__qualname__}{value.__defaults__!r}{value.__kwdefaults__!r}"
        names: set[str] = set()
        yield from _compiled(value.__code__, names)
        cells = dict(zip(value.__code__.co_freevars, value.__closure__ or (), strict=True))
        for name in sorted({*names, *cells}):
            used = cells[name].cell_contents if name in cells else value.__globals__.get(name)
            yield from (f"{name} {text}" for text in _typed(used, seen))
    elif isinstance(value, type) and value.__module__ == "__main__":
        if issubclass(value, BaseModel):
            yield f"{value.__qualname__} {sorted(map(str, value.model_fields.items()))}"
        for name, part in sorted(vars(value).items()):
            if not name.startswith("__") or name in ("__init__", "__call__"):
                yield from (f"{value.__qualname__}.{name} {text}" for text in _typed(part, seen))
        yield from (text for base in value.__bases__ for text in _typed(base, seen))
    elif isinstance(value, (bool, int, float, str, bytes, tuple)) or value is None:
        yield repr(value)


def _compiled(code: CodeType, names: set[str]) -> Iterator[str]:
    names.update(code.co_names)
    yield f"{code.co_name} {code.co_code.hex()} {code.co_names} {code.co_varnames}"
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _compiled(constant, names)
        else:
            yield repr(sorted(constant, key=repr) if isinstance(constant, frozenset) else constant)
