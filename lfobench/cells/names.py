"""Parsing of what a user types: lists of names, globs, seed ranges, ``--set`` assignments."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

from lfobench.contract.method import Method
from lfobench.contract.suite import Suite, Task
from lfobench.errors import UserError, unknown_name
from lfobench.registry import load_method, load_suites

Grids = Mapping[str, Mapping[str, Sequence[Any]]]
"""Method to fields and the values of each."""

MAX_SEED = 2**32 - 1
MAX_RANGE = 10_000


def split_names(text: str) -> list[str]:
    """``"dilo, smodice"`` to its names, order kept, repeats dropped."""
    return list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def chosen_methods(text: str) -> dict[str, type[Method]]:
    """The methods that ``--methods`` names, by what was typed; each has a name of its own.

    Raises:
        UserError: for no method, an unknown one, or two of one name.
    """
    methods = {typed: load_method(typed) for typed in split_names(text)}
    if not methods:
        raise UserError("No method is named.", "Write, for example, --methods dilo,bc.")
    known: dict[str, str] = {}
    for typed, method in methods.items():
        if (other := known.setdefault(method.name, typed)) != typed:
            raise UserError(f"{other} and {typed} are both named '{method.name}'.", "Rename one, or leave it out.")
    return methods


def parse_seeds(text: str) -> list[int]:
    """``"0-2,5"`` to ``[0, 1, 2, 5]``.

    Raises:
        UserError: when a part is neither a number nor a rising range, or a seed is out of range.
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*([0-9]+)\s*(?:-\s*([0-9]+)\s*)?", part)
        # As floats first: int() refuses thousands of digits with an error of its own.
        first, last = (float(match[1]), float(match[2] or match[1])) if match else (1.0, 0.0)
        if first > last:
            raise UserError(
                f"'{text}' is not a list of seeds.", "Write numbers and rising ranges: --seeds 0-6 or 0,3,5."
            )
        if last > MAX_SEED or last - first >= MAX_RANGE:
            raise UserError(
                f"'{text}' is out of range: a seed is at most {MAX_SEED}, a range at most {MAX_RANGE:,} seeds long.",
                "Write, for example, --seeds 0-6.",
            )
        seeds.update(dict.fromkeys(range(int(first), int(last) + 1)))
    return list(seeds)


def chosen_tasks(suite: Suite, globs: str | None) -> list[Task]:
    """The tasks of a suite that ``--tasks`` names; all where it was left out.

    Raises:
        UserError: for a glob that matches nothing, saying where there is a task of that name.
    """
    patterns = ["*"] if globs is None else split_names(globs)
    elsewhere = [glob for glob in patterns if not any(fnmatchcase(task.name, glob) for task in suite.tasks)]
    owners = load_suites().owners if elsewhere else {}
    for name in elsewhere:
        if name in owners:
            raise UserError(f"Task '{name}' is not in suite '{suite.name}'.", f"It is in: --suite {owners[name]}")
    return select_tasks(suite.tasks, patterns)


def select_tasks(tasks: Sequence[Task], patterns: Iterable[str]) -> list[Task]:
    """The tasks that match any of the globs, in suite order.

    Raises:
        UserError: for a pattern that matches nothing.
    """
    names = [task.name for task in tasks]
    chosen: set[str] = set()
    patterns = list(patterns)
    if not patterns:
        raise UserError("No task is named.", "Write, for example, --tasks 'hopper-*', or leave the option out.")
    for pattern in patterns:
        matched = [name for name in names if fnmatchcase(name, pattern)]
        if not matched:
            raise unknown_name("task", pattern, names)
        chosen.update(matched)
    return [task for task in tasks if task.name in chosen]


def parse_assignments(assignments: Sequence[str], methods: Sequence[str]) -> dict[str, dict[str, Any]]:
    """``["dilo.tau=3"]`` to ``{"dilo": {"tau": 3}}``; values are JSON where they parse as JSON, else text.

    Raises:
        UserError: for a malformed assignment or a method that does not run.
    """
    settings: dict[str, dict[str, Any]] = {}
    for assignment in assignments:
        method, field, text = _field_and_text("--set", assignment, methods)
        settings.setdefault(method, {})[field] = _value(text)
    return settings


def parse_grids(grids: Sequence[str], methods: Sequence[str]) -> Grids:
    """``["mine.beta=0.1,0.5"]`` to ``{"mine": {"beta": (0.1, 0.5)}}``; values are spelled as in ``--set``.

    Raises:
        UserError: for a malformed grid, a field named twice, or a method that does not run.
    """
    found: dict[str, dict[str, tuple[Any, ...]]] = {}
    for grid in grids:
        method, field, text = _field_and_text("--grid", grid, methods)
        if field in found.setdefault(method, {}):
            raise UserError(f"--grid names {method}.{field} twice.", "Give all of its values at once.")
        try:
            found[method][field] = tuple(json.loads(f"[{text}]"))
        except (ValueError, RecursionError):
            found[method][field] = tuple(_value(part.strip()) for part in text.split(","))
    return found


_FORMS = {"--set": ("VALUE", "3"), "--grid": ("V1,V2,…", "1,3")}
"""Options that assign to fields of methods: the form of what follows ``=``, and an example."""


def _field_and_text(option: str, typed: str, methods: Sequence[str]) -> tuple[str, str, str]:
    """Method, field and text of ``METHOD.FIELD=TEXT``; the text of a grid is not empty."""
    form, example = _FORMS[option]
    match = re.fullmatch(r"([^.=\s]+)\.([^.=\s]+)=(.*)", typed, flags=re.DOTALL)
    if match is None or (option == "--grid" and not match[3]):
        raise UserError(
            f"{option} '{typed}' is not METHOD.FIELD={form}.", f"Write, for example, {option} dilo.tau={example}."
        )
    method, field, text = match.groups()
    if method not in methods:
        raise unknown_name(f"method in {option}", method, methods)
    return method, field, text


def spelled_grid(method: str, grid: Mapping[str, Sequence[Any]]) -> list[str]:
    """A grid as ``--grid`` takes it, one text per field."""
    texts = []
    for field, values in grid.items():
        plain = all(isinstance(value, str) and _value(value) == value and "," not in value for value in values)
        texts.append(f"{method}.{field}={','.join(values if plain else map(json.dumps, values))}")
    return texts


def _value(text: str) -> Any:
    if text.strip().lower() in ("none", "null"):
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return {"true": True, "false": False}.get(text.strip().lower(), text)
