"""Hyperparameters chosen from grids: what is tried, and what a choice holds for.

A grid is the one that ``--grid`` gives for a method, else the task's, else the method's own.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from math import prod
from typing import Any

from pydantic import ValidationError

from lfobench.cells.cell import Cell
from lfobench.cells.names import Grids, chosen_methods, parse_assignments, parse_grids
from lfobench.cells.plan import Plan, Request
from lfobench.contract.suite import Task
from lfobench.errors import UserError, unknown_name
from lfobench.record import Tuning
from lfobench.text import canonical_json, content_hash

MOST_COMBINATIONS = 10_000
"""Limit on the combinations of one grid."""


@dataclass(frozen=True)
class Search:
    """The grid of one method on one task.

    Attributes:
        cell: what trains without a choice.
        tried: the cell with every combination of the grid's values, those of the last field varying fastest.
    """

    cell: Cell
    tried: tuple[Cell, ...]

    @cached_property
    def grid(self) -> dict[str, list[Any]]:
        """Field to its values, as the configuration spells them, in declared order."""
        fields = self.tried[0].tuned
        return {field: _distinct(cell.tuned[field] for cell in self.tried) for field in fields}

    @cached_property
    def conditions(self) -> dict[str, Any]:
        """All that a choice holds for, as JSON data: the cell's identity, but for what evaluates it, and the grid.

        The choosing itself (seeds, validation starts) is not among it, so a later search takes an earlier one's place.
        """
        return {**_untuned(self.cell.identity, self.grid), "grid": self.grid}

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the conditions; names the choice."""
        return content_hash(self.conditions)

    def trials(self, starts: int) -> tuple[Cell, ...]:
        """Trials in the order of `tried`, evaluated once, when trained, from validation starts."""
        protocol = self.cell.protocol
        once = replace(
            protocol,
            evaluation_every=protocol.steps_for(self.cell.task),
            evaluation_episodes=starts,
            further_episodes=0,
        )
        return tuple(replace(cell, protocol=once, starts="validation") for cell in self.tried)

    def tried_before(self, trial: Mapping[str, Any]) -> bool:
        """True if a trial was made for this choice or an earlier one in its place, by other starts, seeds or values.

        Args:
            trial: the identity of its record.
        """
        fields = {*self.grid, *trial.get("tuned", {})}
        return _untuned(trial, fields) == _untuned(self.cell.identity, fields)

    def chosen(self, tuning: Tuning, kept: Collection[str]) -> Cell:
        """The cell with the chosen values, except in the fields that `kept` names; they stay as they are."""
        values = {field: value for field, value in tuning.chosen.items() if field not in kept}
        if not values:
            return self.cell
        return replace(
            _with_values(self.cell, values, "The choice"), tuning=tuning.model_copy(update={"chosen": values})
        )


def search_of(cell: Cell, asked: Grids | None = None) -> Search | None:
    """The search for a cell's method and task, if there is a grid for it.

    Args:
        cell: what trains without a choice.
        asked: what ``--grid`` says.

    Raises:
        UserError: for a grid that the method cannot take, naming whose mistake that is.
    """
    name = cell.method.name
    whose = {
        f"--grid: the grid of {name}": (asked or {}).get(name),
        f"Suite '{cell.suite_name}', task '{cell.task.name}': the grid of {name}": cell.task.grids.get(name),
        f"Method '{name}': its grid": cell.method.grids,
    }
    where, grid = next(((where, grid) for where, grid in whose.items() if grid), ("", None))
    if grid is None:
        return None
    known = cell.method.Config.model_fields
    for field, values in grid.items():
        if field not in known:
            unknown = unknown_name("field", field, known)
            raise UserError(f"{where} has the field '{field}', which {name} lacks.", unknown.remedy)
        if not values:
            raise UserError(f"{where} has no value for {field}.", "Give it values, or leave the field out.")
    count = prod(len(values) for values in grid.values())
    if count > MOST_COMBINATIONS:
        raise UserError(
            f"{where} has {count:,} combinations; at most {MOST_COMBINATIONS:,} are tried.", "Give it fewer values."
        )
    combinations = [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]
    search = Search(cell, tuple(_with_values(cell, values, where) for values in combinations))
    for field, values in grid.items():
        if len(search.grid[field]) < len(values):
            raise UserError(f"{where} has a value of {field} twice.", "Name every value once.")
    return search


def searches(plan: Plan, request: Request) -> list[Search]:
    """The searches that ``lfobench tune`` makes for a plan, in its order; a cell without a grid has none.

    Args:
        plan: tasks and methods.
        request: what was typed, for ``--set`` and ``--grid``.

    Raises:
        UserError: for a method without a grid on any of the tasks, a field that ``--set`` and a grid both name, or a
            grid that a method cannot take.
    """
    methods = list(dict.fromkeys(cell.method.name for cell in plan.cells))
    asked = parse_grids(request.grids, methods)
    found = [search for cell in plan.cells if (search := search_of(cell, asked)) is not None]
    searched = {search.cell.method.name for search in found}
    for name in methods:
        if name not in searched:
            raise UserError(
                f"There is no grid for {name} on {_listed(plan.tasks)}: neither the suite '{plan.suite.name}' nor the "
                "method declares one.",
                f"Say what to try, --grid {name}.FIELD=V1,V2, or leave it out; "
                f"with a grid: {', '.join(methods_with_grids(plan.tasks)) or 'none'}.",
            )
    assigned = parse_assignments(request.assignments, methods)
    for search in found:
        for field in search.grid:
            if field in assigned.get(search.cell.method.name, {}):
                raise UserError(
                    f"--set {search.cell.method.name}.{field} names a field of the grid on {search.cell.task.name}.",
                    "Leave it out: the search tries the grid's values.",
                )
    return found


def methods_with_grids(tasks: Iterable[Task]) -> list[str]:
    """Methods that any of the tasks declares a grid for, as they first appear."""
    return list(dict.fromkeys(name for task in tasks for name, grid in task.grids.items() if grid))


def tune_command(request: Request, protocol: str, lacking: Sequence[Search], out: str) -> str:
    """Command that makes missing choices: the request, for those methods and tasks.

    Args:
        request: what was typed.
        protocol: its name, where the request leaves it to us.
        lacking: the searches.
        out: the output folder.
    """
    typed = {method.name: text for text, method in chosen_methods(request.methods).items()}
    methods = list(dict.fromkeys(search.cell.method.name for search in lacking))
    fields = {(search.cell.method.name, field) for search in lacking for field in search.grid}
    options = {
        "--methods": ",".join(typed[name] for name in methods),
        "--suite": request.suite,
        "--tasks": ",".join(dict.fromkeys(search.cell.task.name for search in lacking)),
        "--protocol": protocol,
        "--steps": request.assigned.steps,
        "--preset": request.preset,
        "--source": request.source,
        "--device": request.device,
        "--precision": request.precision,
        "--out": out,
    }
    defaults = {"--preset": "released", "--source": "auto", "--device": "auto", "--precision": "auto"}
    words = ["lfobench", "tune"]
    for option, value in options.items():
        if value is not None and value != defaults.get(option):
            words += [option, str(value)]
    for grid in request.grids:
        if grid.partition(".")[0] in methods:
            words += ["--grid", grid]
    for assignment in request.assignments:
        ((method, settings),) = parse_assignments([assignment], list(typed)).items()
        if method in methods and not any((method, field) in fields for field in settings):
            words += ["--set", assignment]
    return shlex.join(words)


def _untuned(identity: Mapping[str, Any], fields: Collection[str]) -> dict[str, Any]:
    """Part of an identity that does not depend on `fields`, the seed and the starts."""
    left_out = ("overrides", "set", "tuned", "starts", "seed")
    return {
        **{name: value for name, value in identity.items() if name not in left_out},
        "config": {field: value for field, value in identity["config"].items() if field not in fields},
        "protocol": {field: identity["protocol"][field] for field in ("name", "steps")},
    }


def _with_values(cell: Cell, values: Mapping[str, Any], where: str) -> Cell:
    """The cell with `values`, which stand `where`, over whatever decided those fields before."""
    try:
        config = cell.method.Config.model_validate({**cell.config.model_dump(), **values})
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        problem = f"{where} has {place} = {first['input']!r}: {first['msg'].lower()}."
        raise UserError(problem, "Fix the value.") from error
    plain = config.model_dump(mode="json")
    return replace(
        cell,
        config=config,
        budget={field: value for field, value in cell.budget.items() if field not in values},
        tuned={field: plain[field] for field in values},
    )


def _listed(tasks: Sequence[Task]) -> str:
    return tasks[0].name if len(tasks) == 1 else f"any of {len(tasks)} tasks"


def _distinct(values: Iterable[Any]) -> list[Any]:
    return list({canonical_json(value): value for value in values}.values())
