"""``lfobench ls`` and ``lfobench show``: names, and everything about one of them."""

from __future__ import annotations

import json
from enum import StrEnum
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

import typer

from lfobench.cli import options
from lfobench.cli.console import output, print_json

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from lfobench.cells.cell import Protocol
    from lfobench.contract.method import Method


class Kind(StrEnum):
    """Kinds of names that ``ls`` lists."""

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
    from lfobench.cells.recipes import described_parts
    from lfobench.registry import load_suite

    return [
        {
            "name": task.name,
            "environment": task.environment.id.rpartition(":")[2],
            "offline": described_parts(task.recipe)[0],
            "expert": described_parts(task.recipe)[1],
            "paper steps": f"{task.paper_steps:,}",
        }
        for task in load_suite(suite).tasks
    ]


def _protocols() -> list[dict[str, Any]]:
    from lfobench.cells.cell import PROTOCOLS

    return [{"name": protocol.name, "summary": protocol.summary} for protocol in PROTOCOLS.values()]


def first_line(described: type) -> str:
    """First line of a docstring."""
    text = described.__doc__
    return next(iter(text.strip().splitlines()), "") if isinstance(text, str) else ""


def show(
    name: Annotated[str, typer.Argument(help="A method, suite, task or protocol.")],
    suite: options.SuiteName = options.DEFAULT_SUITE,
    protocol: options.ProtocolName = "auto",
    source: options.Source = "auto",
    as_json: options.Json = False,
) -> None:
    """Everything about one name: a method's fields and presets, a task's recipe and manifest, a protocol.

    Example: lfobench show dilo
    """
    from lfobench.cells.cell import PROTOCOLS
    from lfobench.cli.options import registered_suites
    from lfobench.errors import unknown_name
    from lfobench.registry import is_place, load_method, load_suite, method_names, suite_names

    loaded = load_suite(suite)
    tasks = {task.name: task for task in loaded.tasks}
    if name in method_names() or is_place(name):
        _show_method(load_method(name), as_json)
    elif name in tasks:
        _show_task(suite, name, protocol, source, as_json)
    elif name in PROTOCOLS:
        _show_fields(PROTOCOLS[name], as_json)
    elif name == loaded.name:
        list_names(Kind.tasks, suite, as_json)
    elif name in suite_names():
        list_names(Kind.tasks, name, as_json)
    elif name in (owners := registered_suites().owners):
        _show_task(owners[name], name, protocol, source, as_json)
    else:
        raise unknown_name("name", name, [*method_names(), *tasks, *PROTOCOLS, *suite_names(), *owners])


def _show_method(method: type[Method], as_json: bool) -> None:
    from rich.markup import escape
    from rich.table import Table

    rows = []
    for field, info in method.Config.model_fields.items():
        row: dict[str, Any] = {"field": field, "takes": _takes(info)}
        default = "required" if info.is_required() else info.get_default(call_default_factory=True, validated_data={})
        row |= {preset: changes.get(field, default) for preset, changes in method.presets.items()}
        row |= {budget: changes.get(field, "") for budget, changes in method.budgets.items()}
        rows.append(row)
    descriptions = {field: info.description for field, info in method.Config.model_fields.items()}
    if as_json:
        print_json({"method": method.name, "fields": rows, "descriptions": descriptions})
        return
    output.print(f"[bold]{method.name}[/] (version {method.version}): {escape(first_line(method))}", soft_wrap=True)
    table = Table(caption="The presets, then what a protocol changes for its budget. Bold: the presets differ.")
    # What a field takes stands with its description below: here it would squeeze the numbers.
    headers = [header for header in rows[0] if header != "takes"]
    for header in headers:
        table.add_column(header, no_wrap=header == "field", overflow="fold")
    for row in rows:
        differ = len({str(row[preset]) for preset in method.presets}) > 1
        table.add_row(*(escape(_spelling(row[header])) for header in headers), style="bold" if differ else None)
    output.print(table)
    for row in rows:
        description = escape(str(descriptions[row["field"]]))
        output.print(f"[bold]{row['field']}[/] ({escape(row['takes'])}): {description}", soft_wrap=True)


def _spelling(value: Any) -> str:
    """A value as ``--set`` takes it."""
    return value if isinstance(value, str) else "none" if value is None else json.dumps(value, default=str)


def _takes(field: FieldInfo) -> str:
    """Values that a field accepts: ``kl | chi2``, ``int, >= 1``, ``float or none, > 0``."""
    kinds = {int: "int", float: "float", bool: "true or false", str: "text", type(None): "none"}
    union = get_origin(field.annotation) in (Union, UnionType)
    parts = get_args(field.annotation) if union else (field.annotation,)
    words = []
    for part in parts:
        if get_origin(part) is Annotated:
            part = get_args(part)[0]
        if get_origin(part) is Literal:
            words.append(" | ".join(map(str, get_args(part))))
        elif get_origin(part) is tuple:
            words.append("list of int")
        else:
            words.append(kinds.get(part, getattr(part, "__name__", str(part))))
    signs = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}
    bounds = [
        f"{sign} {getattr(bound, name)}"
        for bound in field.metadata
        for name, sign in signs.items()
        if hasattr(bound, name)
    ]
    return ", ".join([" or ".join(words), *bounds])


def _show_task(suite: str, name: str, protocol_name: str, source: str, as_json: bool) -> None:
    from rich.markup import escape

    from lfobench.cells.recipes import described, recipe_identity
    from lfobench.cells.sources import absent_files, download_command
    from lfobench.cli import planned
    from lfobench.data.manifest import manifest
    from lfobench.data.requested import requested_data

    requested = requested_data(suite, name, protocol_name, source)
    (task,), protocol = requested.tasks, requested.protocol
    recipe = protocol.recipe_for(task)
    complete = all(row["shards_present"] == row["shards"] for row in requested.rows())
    counted = manifest(requested.load(task)) if complete else None
    if as_json:
        print_json({"task": planned.plain(task), "recipe": recipe_identity(recipe), "manifest": planned.plain(counted)})
        return
    environment = task.environment
    arguments = "".join(f", {field} {_spelling(value)}" for field, value in environment.arguments.items())
    steps = f"{environment.horizon} steps per episode"
    output.print(f"[bold]{task.name}[/]: {environment.id}{escape(arguments)}, {steps}", soft_wrap=True)
    output.print(f"score 0 = return {environment.random_return:g}, score 100 = return {environment.expert_return:g}")
    output.print(
        f"recipe ({protocol.name}): {described(recipe)}; {protocol.for_task(task).steps_for(task):,} steps",
        soft_wrap=True,
    )
    for method, grid in task.grids.items():
        fields = "; ".join(f"{field} {', '.join(map(_spelling, values))}" for field, values in grid.items())
        output.print(f"grid of {method}: {escape(fields)}", soft_wrap=True)
    if absent := absent_files([task]):
        names = ", ".join(file.name for file in absent)
        fetch = download_command(suite, requested.source, name)
        output.print(f"files not here: {escape(names)}; fetch them: {escape(fetch)}", soft_wrap=True)
        return
    if counted is None:
        output.print(f"data not built yet: {escape(requested.rebuild(task))}", soft_wrap=True)
        return
    for line in counted.sentences():
        output.print(line, soft_wrap=True)


def _show_fields(protocol: Protocol, as_json: bool) -> None:
    from lfobench.cli import planned

    of_tasks = ("assigned", "further_episodes", "methods_as")
    fields = {name: value for name, value in planned.plain(protocol).items() if name not in of_tasks}
    if as_json:
        print_json(fields)
        return
    for name, value in fields.items():
        output.print(f"{name:24} {'from the task' if value is None else value}")
