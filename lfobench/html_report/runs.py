"""Where every number comes from: one row per run, and the full identities behind them."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lfobench.record import Failure, Record, usable
from lfobench.score import Statistic
from lfobench.stats.highlight import Rule
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.exporters.html import Markup, element, name_of
from lfobench.tables.table import MISSING, Table
from lfobench.text import short_number

_SHORT = 12
"""Characters of a hash in a table; enough to tell any two apart, and to find a record's file by."""

_HEADINGS = (
    ("Method", "text"),
    ("Task", "text"),
    ("Seed", "number"),
    ("Status", "text"),
    ("Score", "number"),
    ("Steps", "number"),
    ("Wall time", "number"),
    ("Device", "text"),
    ("Software", "text"),
    ("Data", "text"),
    ("Source revision", "text"),
    ("Identity", "text"),
)


class Numbered:
    """Distinct texts in order of appearance, each with a number from 1 on."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def number(self, text: str) -> int:
        """The number of `text`, a new one where it is new."""
        if text not in self.texts:
            self.texts.append(text)
        return self.texts.index(text) + 1


def runs_section(table: Table, records: Sequence[Record]) -> Markup:
    """The sortable table of runs, then what its short forms stand for."""
    software, data = Numbered(), Numbered()
    rows: list[Markup] = []
    identities: list[Markup] = []
    for label, members in cells(table, records):
        anchor = f"identity-{len(identities) + 1}"
        rows += [_row(label, record, table.statistic, software, data, anchor) for record in members]
        identities.append(_identity(label, members, anchor))
    headings = [element("th", name, scope="col", data_sort=kind) for name, kind in _HEADINGS]
    return element(
        "section",
        element("h2", "Runs"),
        element(
            "div",
            element(
                "table",
                element("thead", element("tr", *headings)),
                element("tbody", *rows),
                class_="plain sortable",
                id="runs-table",
            ),
            class_="scroll tall",
            tabindex="0",
            role="region",
            aria_label="Runs",
        ),
        element(
            "p",
            f"{len(records)} runs, one record each. Wall time: training, evaluation and loading, "
            "of all seeds that were trained together.",
            class_="caption",
        ),
        _numbered("Software", software, "software"),
        _numbered("Data fingerprints", data, "data"),
        element("h3", "Identities"),
        element(
            "p",
            "Every field that decides a run's result, apart from its seed, and the SHA-256 of each run's identity.",
            class_="caption",
        ),
        element("details", element("summary", f"{len(identities)} identities"), *identities),
        id="runs",
    )


def cells(table: Table, records: Sequence[Record]) -> Iterator[tuple[str, list[Record]]]:
    """(column label, its records by seed) of every cell with records, in table order."""
    columns = arrange_columns(records)
    for _, row in table.rows():
        for column in table.columns:
            members = [record for record in columns.get(column, []) if record.task == row.task]
            if members:
                yield column.label, sorted(members, key=lambda record: record.seed)


def wall_time(record: Record) -> float | None:
    """Seconds that a run took; None where its record does not say."""
    seconds = record.provenance.get("seconds")
    if not isinstance(seconds, Mapping):
        return None
    known = [value for value in seconds.values() if usable(value)]
    return float(sum(known)) if known else None


def software_of(record: Record) -> str:
    """``torch 2.13.0+cpu, numpy 1.26.4, …; Python 3.11.7; Linux-…``; empty where the record does not say."""
    packages = record.provenance.get("packages")
    parts = [_assigned(packages, " ")] if isinstance(packages, Mapping) else []
    if python := record.provenance.get("python"):
        parts.append(f"Python {python}")
    if platform := record.provenance.get("platform"):
        parts.append(str(platform))
    return "; ".join(filter(None, parts))


def _row(label: str, record: Record, statistic: Statistic, software: Numbered, data: Numbered, anchor: str) -> Markup:
    score, seconds = record.score(statistic), wall_time(record)
    status = record.status + (f" at {record.diverged_at:,}" if record.diverged_at is not None else "")
    revision = str(record.provenance.get("source_revision") or "")
    steps = record.identity["protocol"]["steps"]
    return element(
        "tr",
        element("th", name_of(label), scope="row"),
        element("td", name_of(record.task)),
        element("td", str(record.seed), class_="number"),
        element("td", status, class_="warned" if record.status == "diverged" else None),
        element("td", short_number(score), class_="number", data_value=repr(score)),
        element("td", f"{steps:,}", class_="number", data_value=str(steps)),
        element(
            "td",
            MISSING if seconds is None else _duration(seconds),
            class_="number",
            data_value=None if seconds is None else repr(seconds),
        ),
        element("td", _device(record) or MISSING),
        _reference(software_of(record), software, "software"),
        _reference(_assigned(record.provenance.get("data_fingerprints", {}), " "), data, "data"),
        element("td", revision[:_SHORT] or MISSING, class_="code", title=revision or None),
        element(
            "td",
            element("a", record.identity_hash[:_SHORT], href=f"#{anchor}"),
            *([" ", element("span", "warnings", class_="warned")] if record.warnings else []),
            class_="code",
        ),
    )


def _identity(label: str, members: Sequence[Record], anchor: str) -> Markup:
    first = members[0]
    shared = {field: value for field, value in first.identity.items() if field != "seed"}
    warnings = dict.fromkeys(f"{warning.what} {warning.remedy}" for record in members for warning in record.warnings)
    return element(
        "details",
        element("summary", name_of(label), " on ", name_of(first.task)),
        element(
            "div",
            element("ul", *(element("li", f"Warning: {warning}") for warning in warnings)) if warnings else "",
            element(
                "pre",
                "\n".join(f"seed {record.seed}: {record.identity_hash}" for record in members),
                tabindex="0",
            ),
            element("pre", json.dumps(shared, indent=1, ensure_ascii=False), tabindex="0"),
            id=anchor,
        ),
        class_="identity",
    )


def _reference(text: str, known: Numbered, kind: str) -> Markup:
    if not text:
        return element("td", MISSING)
    number = known.number(text)
    return element("td", element("a", f"{kind} {number}", href=f"#{kind}-{number}"))


def _numbered(heading: str, known: Numbered, kind: str) -> Markup:
    if not known.texts:
        return Markup("")
    entries = [
        element("div", element("dt", f"{kind} {number}"), " ", element("dd", text), id=f"{kind}-{number}")
        for number, text in enumerate(known.texts, start=1)
    ]
    return element("div", element("h3", heading), element("dl", *entries, class_="pairs code"))


def _device(record: Record) -> str:
    device = record.provenance.get("device")
    if not isinstance(device, Mapping):
        return ""
    said: list[Callable[[Mapping[str, Any]], Any]] = [
        lambda known: known.get("type"),
        lambda known: known.get("name"),
        lambda known: known.get("precision"),
    ]
    return ", ".join(str(value) for say in said if (value := say(device)))


def _assigned(fields: Any, between: str) -> str:
    return ", ".join(f"{name}{between}{value}" for name, value in fields.items()) if isinstance(fields, Mapping) else ""


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


FOLDER = "reproduction"
"""Where the commands put their records: a new folder, or they would find everything done."""


@dataclass(frozen=True)
class _Conditions:
    """What one ``lfobench run`` holds fixed."""

    suite: str
    source: str
    protocol: str
    steps: int | None
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


def view_arguments(statistic: Statistic, filters: Sequence[str]) -> list[str]:
    """What a table and a report share besides the knobs."""
    return ["--out", FOLDER, "--stat", str(statistic), *filters]


def knobs(rule: Rule) -> list[str]:
    """The four knobs as options."""
    alpha = repr(rule.alpha)
    return ["--test", rule.test, "--scope", rule.scope, "--correction", rule.correction, "--alpha", alpha]


def reproduce_section(
    records: Sequence[Record],
    failures: Sequence[Failure],
    statistic: Statistic,
    rule: Rule,
    filters: Sequence[str] = (),
) -> Markup:
    """The commands, each to be copied; the knobs among them follow those of the page."""
    view = view_arguments(statistic, filters)
    runs = [_command(["lfobench", *arguments]) for arguments in run_commands(records, failures)]
    revisions = list(dict.fromkeys(str(record.provenance.get("source_revision") or "unknown") for record in records))
    return element(
        "section",
        element("h2", "Reproduce"),
        element(
            "p",
            f"Into a new folder, so that nothing is taken from what is done. On a CPU the same software gives the same "
            f"numbers; other builds may differ. Source revision{'s' if len(revisions) > 1 else ''} of these runs: ",
            element("code", ", ".join(revisions)),
            ".",
        ),
        element("h3", "The runs"),
        *runs,
        element("h3", "The table, with the knobs as set above"),
        _command(["lfobench", "table", *view], rule),
        element("h3", "This page"),
        _command(["lfobench", "report", *view, "--to", "report.html"], rule),
        id="reproduce",
    )


def _command(arguments: Sequence[str], rule: Rule | None = None) -> Markup:
    text = shlex.join(arguments)
    options = [" ", element("span", shlex.join(knobs(rule)), class_="knob-options")] if rule else []
    return element("pre", element("code", text, *options), class_="command", tabindex="0")


def _conditions(run: Record | Failure) -> _Conditions:
    protocol = run.identity["protocol"]
    return _Conditions(
        suite=run.labels.suite,
        source=str(run.identity["source"]),
        protocol=str(protocol["name"]),
        steps=int(protocol["steps"]) if protocol["steps_assigned"] else None,
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
        *("--seeds", seed_list(seeds)),
        *("--preset", conditions.preset),
        *precision,
        *assigned,
        *("--out", FOLDER),
    ]
