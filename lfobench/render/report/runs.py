"""Where every number comes from: one row per run, and the full identities behind them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from lfobench.contract.record import Record, usable
from lfobench.contract.statistic import Statistic
from lfobench.render.cell_text import MISSING
from lfobench.render.columns import arrange_columns
from lfobench.render.markup import Markup, element, name_of
from lfobench.render.table import Table
from lfobench.words import short_number

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
