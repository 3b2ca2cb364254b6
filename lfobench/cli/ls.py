"""``lfobench ls``: what there is."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any

import typer

from lfobench.cli import options
from lfobench.cli.console import output, print_json


class Kind(StrEnum):
    """What ``ls`` lists."""

    methods = "methods"
    suites = "suites"
    tasks = "tasks"
    protocols = "protocols"


def list_names(
    kind: Annotated[Kind, typer.Argument(help="methods, suites, tasks or protocols.")],
    suite: options.SuiteName = options.DEFAULT_SUITE,
    as_json: options.Json = False,
) -> None:
    """List what is registered, built in or from other packages.

    Example: lfobench ls tasks --suite locomotion
    """
    from rich.markup import escape
    from rich.table import Table

    rows = {
        Kind.methods: _methods,
        Kind.suites: _suites,
        Kind.tasks: lambda: _tasks(suite),
        Kind.protocols: _protocols,
    }[kind]()
    if as_json:
        print_json(rows)
        return
    table = Table()
    for column, header in enumerate(rows[0]):
        longest = max(len(str(row[header])) for row in rows)
        table.add_column(header, no_wrap=column == 0 and 2 * longest < output.width, overflow="fold")
    for row in rows:
        table.add_row(*(escape(str(value)) for value in row.values()))
    output.print(table)


def _methods() -> list[dict[str, Any]]:
    from lfobench.registry import method_names

    return [_method_row(name) for name in method_names()]


def _method_row(name: str) -> dict[str, Any]:
    from lfobench.errors import UserError
    from lfobench.registry import load_method

    try:
        method = load_method(name)
    except UserError as error:
        # Somebody's broken package must not take the list along.
        return {"name": name, "expert actions": "", "presets": "", "summary": str(error)}
    return {
        "name": name,
        "expert actions": "yes" if method.access_to_expert_actions else "no",
        "presets": ", ".join(method.presets),
        "summary": first_line(method),
    }


def _suites() -> list[dict[str, Any]]:
    from lfobench.registry import suite_names

    return [_suite_row(name) for name in suite_names()]


def _suite_row(name: str) -> dict[str, Any]:
    from lfobench.errors import UserError
    from lfobench.registry import load_suite

    try:
        suite = load_suite(name)
    except UserError as error:
        return {"name": name, "tasks": "", "summary": str(error)}
    return {"name": suite.name, "tasks": len(suite.tasks), "summary": suite.summary}


def _tasks(suite: str) -> list[dict[str, Any]]:
    from lfobench.registry import load_suite

    return [
        {
            "name": task.name,
            "environment": task.environment.id.rpartition(":")[2],
            "offline": task.recipe.words[0],
            "expert": task.recipe.words[1],
            "paper steps": f"{task.paper_steps:,}",
        }
        for task in load_suite(suite).tasks
    ]


def _protocols() -> list[dict[str, Any]]:
    from lfobench.cells.cell import PROTOCOLS

    return [{"name": protocol.name, "summary": protocol.summary} for protocol in PROTOCOLS.values()]


def first_line(described: type) -> str:
    """Of its docstring."""
    text = described.__doc__
    return next(iter(text.strip().splitlines()), "") if isinstance(text, str) else ""
