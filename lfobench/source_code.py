"""Source files of a method that does not ship with lfobench: whoever edits one has another method.

Methods that ship with lfobench are identified by their `version`, which the pinned numbers hold them to.
"""

from __future__ import annotations

import ast
import hashlib
import re
import sys
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import MISSING, is_dataclass
from dataclasses import fields as dataclass_fields
from dis import get_instructions
from enum import Enum
from functools import cache, cached_property, partial
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path
from types import (
    CellType,
    CodeType,
    EllipsisType,
    FunctionType,
    GetSetDescriptorType,
    MappingProxyType,
    MemberDescriptorType,
    MethodType,
    ModuleType,
    NoneType,
)
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from lfobench.contract.method import Method
from lfobench.errors import UserError
from lfobench.python_files import PREFIX
from lfobench.shipped import HOME, PACKAGES, is_shipped
from lfobench.text import canonical_json, content_hash

SESSION = "<session>"
"""In the place of a file's name: a class that was typed into an interactive session."""

_PLAIN = (bool, int, float, complex, str, bytes, NoneType, EllipsisType, range)


@cache
def _plain() -> tuple[type, ...]:
    """Kinds of values that their own text stands for."""
    import torch

    return (*_PLAIN, torch.dtype, torch.device)


_CONTAINERS = (list, tuple, deque, dict, MappingProxyType, set, frozenset)

_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")

_GENERATED = frozenset(
    f"__{name}__" for name in ("init", "repr", "eq", "hash", "lt", "le", "gt", "ge", "setattr", "delattr", "replace")
)
"""Functions that `dataclass` writes from the fields."""


def ships(method: type[Method]) -> bool:
    """Whether a method is one of lfobench's own."""
    return _top(method) == "methods" and (_file(method) or Path()).resolve().parent == HOME / "methods"


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
        return {SESSION: content_hash(sorted(set(_typed(method, method.__qualname__, set()))))}
    return _hashes(method.__module__, file)


def _hashes(module: str, file: Path) -> dict[str, str]:
    """By path below the folder of a module's top-level package, of the module's closure."""
    root = file.parent
    if not module.startswith(("__main__", PREFIX)):
        packages = module.count(".") + (file.name == "__init__.py")
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
            if top == own:
                waiting += _files(root, dotted)
            elif not (alone or top == "lfobench" or top in sys.stdlib_module_names):
                waiting += [
                    each
                    for each in _files(root, dotted)
                    if top not in PACKAGES or not (HOME / each.relative_to(root)).is_file()
                ]
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
    file, made_from = _file(method), vars(method).get("_source")
    if file is not None and made_from is not None and made_from != hashlib.sha256(file.read_bytes()).hexdigest():
        raise UserError(f"{file} was edited after its method '{method.name}' was imported.", "Start Python again.")


def _typed(value: Any, where: str, seen: set[int]) -> Iterator[str]:
    """What was typed of a class, function or value, and of everything else that its code names.

    Args:
        value: of the session, or what the session has from elsewhere: then the files of that place, unless installed.
        where: the name that it has, for messages.
        seen: the classes, functions and containers on the way, by id.

    Raises:
        UserError: for a value that no text stands for, so that nobody could notice when it changes.
    """
    if isinstance(value, _plain()):
        yield repr(value)
    elif isinstance(value, ModuleType):
        yield f"module {value.__name__}"
        yield from _neighbour(value.__name__, below=True)
    elif isinstance(value, (MemberDescriptorType, GetSetDescriptorType)):
        yield "descriptor"
    elif id(value) in seen:
        yield f"again {getattr(value, '__qualname__', type(value).__name__)}"
    else:
        seen.add(id(value))
        yield from _typed_once(value, where, seen)
        if isinstance(value, _CONTAINERS):  # kept only against cycles: two of them may share an address in time
            seen.remove(id(value))


def _typed_once(value: Any, where: str, seen: set[int]) -> Iterator[str]:
    if isinstance(value, _CONTAINERS):
        items = value.items() if isinstance(value, Mapping) else value
        parts = ["\n".join(_typed(part, where, seen)) for part in items]
        ordered = sorted(parts) if isinstance(value, (set, frozenset)) else parts
        yield f"{type(value).__name__} {canonical_json(ordered)}"
    elif isinstance(value, (classmethod, staticmethod, MethodType)):
        yield str(type(value).__qualname__)
        yield from _typed(value.__func__, where, seen)
        if isinstance(value, MethodType):
            owner = value.__self__
            yield from _typed(owner if isinstance(owner, type) else type(owner), where, seen)
            yield from _typed({} if isinstance(owner, type) else getattr(owner, "__dict__", {}), where, seen)
    elif isinstance(value, property):
        yield from (text for part in (value.fget, value.fset) for text in _typed(part, where, seen))
    elif isinstance(value, cached_property):
        yield from _typed(value.func, where, seen)
    elif isinstance(value, partial):
        yield from _typed([value.func, value.args, value.keywords], where, seen)
    elif isinstance(value, FunctionType):
        yield from _typed_function(value, where, seen)
    elif isinstance(value, type) and value.__module__ == "__main__":
        yield from _typed_class(value, seen)
    elif isinstance(value, Enum):
        yield f"{type(value).__qualname__}.{value.name}"
        yield from _typed(value.value, where, seen)
        yield from _typed(type(value), where, seen)
    elif callable(value) and isinstance(getattr(value, "__name__", None), str):
        yield f"{value.__module__}.{getattr(value, '__qualname__', value.__name__)}"
        yield from _neighbour(value.__module__)
        if hasattr(value, "__wrapped__"):
            yield from _typed(value.__wrapped__, where, seen)
    else:
        raise UserError(
            f"A class that was typed into this session uses '{where}', a {type(value).__name__}, whose changes nobody "
            "would notice.",
            "Put the class into a file.",
        )


def _typed_function(function: FunctionType, where: str, seen: set[int]) -> Iterator[str]:
    module = function.__globals__.get("__name__")
    yield f"{module}.{function.__qualname__}"
    variables = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    used = {name: cell.cell_contents for name, cell in variables.items() if _is_set(cell)}
    if module == "__main__":
        yield from _compiled(function.__code__)
        names, imported = _names(function.__code__)
        used |= {name: function.__globals__[name] for name in names if name in function.__globals__}
        yield from (text for name in imported for text in _neighbour(name))
        for defaults in (function.__defaults__, function.__kwdefaults__):
            yield from (f"default {text}" for text in _typed(defaults, function.__qualname__, seen))
    else:
        yield from _neighbour(module)
        # What else a library's own functions keep is the library's.
        kinds = (*_plain(), *_CONTAINERS, FunctionType, MethodType, type, partial)
        used = {name: value for name, value in used.items() if isinstance(value, kinds)}
    for name, value in sorted(used.items()):
        yield from (f"{name} {text}" for text in _typed(value, name, seen))


def _typed_class(kind: type, seen: set[int]) -> Iterator[str]:
    name = kind.__qualname__
    fields: list[tuple[str, Any, Any, Any]] = []
    if issubclass(kind, BaseModel):
        for field, info in kind.model_fields.items():
            fields.append((field, [info.annotation, *info.metadata], info.default, info.default_factory))
    if is_dataclass(kind):
        fields += [(each.name, each.type, each.default, each.default_factory) for each in dataclass_fields(kind)]
    for field, annotation, *defaults in fields:
        yield f"{name}.{field}: {_ADDRESS.sub('', repr(annotation))}"
        for default in defaults:
            if default is not MISSING and default is not PydanticUndefined:
                yield from (f"{name}.{field} {text}" for text in _typed(default, f"{name}.{field}", seen))
    generated = _GENERATED if is_dataclass(kind) else frozenset()
    for part, value in sorted(vars(kind).items()):
        special = part.startswith("__") and not isinstance(value, (FunctionType, classmethod, staticmethod))
        if not special and part not in generated and part not in ("_abc_impl", "_source"):
            yield from (f"{name}.{part} {text}" for text in _typed(value, f"{name}.{part}", seen))
    yield from (text for base in kind.__bases__ for text in _typed(base, base.__qualname__, seen))


def _neighbour(module: str | None, below: bool = False) -> Iterator[str]:
    """The files of a module that is neither installed nor lfobench's, and what it imports from its folder.

    Args:
        module: its name; one that cannot be found has no files.
        below: whether the modules below it that are loaded count as well.
    """
    top = (module or "__main__").partition(".")[0]
    if module is None or top in ("__main__", "lfobench") or top in sys.stdlib_module_names:
        return
    if not is_shipped(module):
        file = _module_file(module)
        if {"site-packages", "dist-packages"} & {*file.parts}:
            return
        if file.is_file():
            yield from (f"file {name} {digest}" for name, digest in _hashes(module, file).items())
    if below:
        for name in sorted(name for name in sys.modules if name.startswith(f"{module}.")):
            yield from _neighbour(name)


def _module_file(module: str) -> Path:
    """File of a module, whether it is loaded or not; a folder where it has none."""
    named = getattr(sys.modules.get(module), "__file__", None)
    if module not in sys.modules:
        with suppress(ImportError, AttributeError, ValueError):
            named = getattr(find_spec(module), "origin", None)
    return Path(named or "").absolute()


def _is_set(cell: CellType) -> bool:
    """Whether a variable of an enclosing function has a value yet."""
    try:
        _ = cell.cell_contents
    except ValueError:
        return False
    return True


def _names(code: CodeType) -> tuple[set[str], set[str]]:
    """Globals that code reads, and modules that it may import; also of the functions within."""
    read: set[str] = set()
    imported: set[str] = set()
    package = ""
    for instruction in get_instructions(code):
        if instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            read.add(instruction.argval)
        elif instruction.opname == "IMPORT_NAME":
            package = instruction.argval
            imported.add(package)
        elif instruction.opname == "IMPORT_FROM":
            imported.add(f"{package}.{instruction.argval}")
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            for found, more in zip((read, imported), _names(constant), strict=True):
                found |= more
    return read, imported


def _compiled(code: CodeType) -> Iterator[str]:
    yield f"{code.co_name} {code.co_code.hex()} {code.co_names} {code.co_varnames}"
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _compiled(constant)
        else:
            yield repr(sorted(constant, key=repr) if isinstance(constant, frozenset) else constant)
