"""The commands that make a page's runs, its table and the page itself again."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from lfobench.record import Failure, Record
from lfobench.score import Statistic
from lfobench.stats.highlight import Rule

FOLDER = "reproduction"
"""Folder of the commands' records: a new one, or they would find everything done."""


@dataclass(frozen=True)
class Commands:
    """Commands as a shell takes them.

    Attributes:
        runs: those that make the runs.
        table: the table's, without the knobs.
        page: the page's, without the knobs.
        knobs: the knobs as options, to follow `table` and `page`.
        revisions: source revisions of the runs.
    """

    runs: tuple[str, ...]
    table: str
    page: str
    knobs: str
    revisions: tuple[str, ...]


def commands(
    records: Sequence[Record],
    failures: Sequence[Failure],
    statistic: Statistic,
    rule: Rule,
    filters: Sequence[str] = (),
) -> Commands:
    """All commands of a page; `filters` select its records in a folder."""
    # Its default depends on the records, so the statistic is written out.
    view = ["--out", FOLDER, "--stat", str(statistic), *filters]
    return Commands(
        tuple(shlex.join(["lfobench", *arguments]) for arguments in run_commands(records, failures)),
        shlex.join(["lfobench", "table", *view]),
        shlex.join(["lfobench", "report", *view, "--to", "report.html"]),
        knob_options(rule),
        tuple(dict.fromkeys(str(record.provenance.get("source_revision") or "unknown") for record in records)),
    )


def knob_options(rule: Rule) -> str:
    """The four knobs as options."""
    return f"--test {rule.test} --scope {rule.scope} --correction {rule.correction} --alpha {rule.alpha!r}"


@dataclass(frozen=True)
class _Conditions:
    """Conditions that one ``lfobench run`` holds fixed."""

    suite: str
    source: str
    protocol: str
    steps: int | None
    evaluations: tuple[int, int, int]
    preset: str
    precision: str


@dataclass(frozen=True)
class _Variant:
    """A method with its ``--set``."""

    method: str
    assignments: tuple[str, ...]


Part = tuple[_Conditions, tuple[str, ...], tuple[int, ...]]
"""Conditions, tasks and seeds: what methods must share to be run by one command."""


def run_commands(records: Sequence[Record], failures: Sequence[Failure] = ()) -> list[list[str]]:
    """Arguments of the ``lfobench run`` commands that make these runs, those that crashed included, and no others."""
    seeds: dict[tuple[_Conditions, _Variant], dict[str, set[int]]] = {}
    runs: list[Record | Failure] = [*records, *failures]
    for run in runs:
        by_task = seeds.setdefault((_conditions(run), _variant(run)), {})
        by_task.setdefault(run.task, set()).add(run.seed)
    parts: dict[Part, list[_Variant]] = {}
    for (conditions, variant), by_task in seeds.items():
        tasks: dict[tuple[int, ...], list[str]] = {}
        for task, found in by_task.items():
            tasks.setdefault(tuple(sorted(found)), []).append(task)
        for those_seeds, those_tasks in tasks.items():
            parts.setdefault((conditions, tuple(those_tasks), those_seeds), []).append(variant)
    return [_arguments(part, variants) for part, found in parts.items() for variants in _one_each(found)]


def seed_list(seeds: Sequence[int]) -> str:
    """Ascending seeds as ``--seeds`` reads them: ``0-2,5``."""
    ranges: list[list[int]] = []
    for seed in seeds:
        if ranges and seed == ranges[-1][-1] + 1:
            ranges[-1][1:] = [seed]
        else:
            ranges.append([seed])
    return ",".join("-".join(map(str, each)) for each in ranges)


def _conditions(run: Record | Failure) -> _Conditions:
    protocol = run.identity["protocol"]
    return _Conditions(
        suite=run.labels.suite,
        source=str(run.identity["source"]),
        protocol=str(protocol["name"]),
        steps=int(protocol["steps"]) if protocol["steps_assigned"] else None,
        # In full: a record does not say which of them are the protocol's or the task's own.
        evaluations=(
            int(protocol["evaluation_every"]),
            int(protocol["evaluation_episodes"]),
            int(protocol.get("further_episodes", 0)),
        ),
        preset=str(run.identity["preset"]),
        precision=str(run.identity.get("precision", "auto")),
    )


def _variant(run: Record | Failure) -> _Variant:
    assigned = run.identity["set"]
    return _Variant(run.method, tuple(f"{run.method}.{name}={_value(value)}" for name, value in assigned.items()))


def _value(value: Any) -> str:
    """A value as ``--set`` reads it: text as it is, unless it would be read as something else."""
    if not isinstance(value, str):
        return json.dumps(value)
    try:
        json.loads(value)
    except ValueError:
        return json.dumps(value) if value.strip().lower() in ("none", "null", "true", "false") else value
    return json.dumps(value)


def _one_each(variants: Sequence[_Variant]) -> Iterator[list[_Variant]]:
    """Groups in which no method occurs twice: a command runs a method in one way."""
    waiting = list(variants)
    while waiting:
        group: list[_Variant] = []
        for variant in waiting:
            if all(variant.method != other.method for other in group):
                group.append(variant)
        yield group
        waiting = [variant for variant in waiting if variant not in group]


def _arguments(part: Part, variants: Sequence[_Variant]) -> list[str]:
    conditions, tasks, seeds = part
    steps = [] if conditions.steps is None else ["--steps", str(conditions.steps)]
    every, episodes, final = map(str, conditions.evaluations)
    precision = [] if conditions.precision == "auto" else ["--precision", conditions.precision]
    assigned = [word for variant in variants for each in variant.assignments for word in ("--set", each)]
    return [
        "run",
        *("--methods", ",".join(variant.method for variant in variants)),
        *("--suite", conditions.suite),
        *("--tasks", ",".join(re.sub(r"([*?\[])", r"[\1]", task) for task in tasks)),
        *("--source", conditions.source),
        *("--protocol", conditions.protocol),
        *steps,
        *("--evaluation-every", every, "--evaluation-episodes", episodes, "--final-episodes", final),
        *("--seeds", seed_list(seeds)),
        *("--preset", conditions.preset),
        *precision,
        *assigned,
        *("--out", FOLDER),
    ]
