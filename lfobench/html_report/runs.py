"""The provenance of every number: one row per run, and the identities, software and data behind them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lfobench.record import Record, usable
from lfobench.score import Statistic
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.table import Table
from lfobench.text import short_number

SHORT_HASH = 12
"""Characters of a hash in a table; enough to tell any two apart, and to find a record's file by."""


@dataclass(frozen=True)
class RunRow:
    """One run, as the page lists it.

    Attributes:
        record: of the run.
        status: with the step of its divergence.
        score: unrounded.
        seconds: wall time; None where the record does not say.
        software: number of its software among the page's, from 1 on; None where the record does not say.
        data: number of its data's fingerprints.
        device: empty where the record does not say.
        revision: of the source; empty where the record does not say.
    """

    record: Record
    status: str
    score: float
    seconds: float | None
    software: int | None
    data: int | None
    device: str
    revision: str

    @property
    def score_text(self) -> str:
        """The score to one decimal."""
        return short_number(self.score)

    @property
    def steps(self) -> int:
        """Gradient steps of its protocol."""
        return int(self.record.identity["protocol"]["steps"])

    @property
    def duration(self) -> str | None:
        """Wall time in a suitable unit."""
        seconds = self.seconds
        if seconds is None:
            return None
        if seconds < 90:
            return f"{seconds:.0f} s"
        return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


@dataclass(frozen=True)
class CellRuns:
    """The runs of one cell; they share their identity apart from the seed."""

    label: str
    task: str
    runs: tuple[RunRow, ...]
    identity: str
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Provenance:
    """Cells in table order; distinct descriptions of software and data in order of appearance."""

    cells: tuple[CellRuns, ...]
    software: tuple[str, ...]
    data: tuple[str, ...]


def provenance(table: Table, records: Sequence[Record]) -> Provenance:
    """The provenance of the records behind `table`."""
    software: dict[str, int] = {}
    data: dict[str, int] = {}
    found = tuple(
        CellRuns(
            label,
            members[0].task,
            tuple(_run(record, table.statistic, software, data) for record in members),
            json.dumps(
                {field: value for field, value in members[0].identity.items() if field != "seed"},
                indent=1,
                ensure_ascii=False,
            ),
            tuple(dict.fromkeys(f"{each.what} {each.remedy}" for record in members for each in record.warnings)),
        )
        for label, members in cells(table, records)
    )
    return Provenance(found, tuple(software), tuple(data))


def cells(table: Table, records: Sequence[Record]) -> Iterator[tuple[str, list[Record]]]:
    """(column label, its records by seed) of every cell with records, in table order."""
    columns = arrange_columns(records)
    for _, row in table.rows():
        for column in table.columns:
            members = [record for record in columns.get(column, []) if record.task == row.task]
            if members:
                yield column.label, sorted(members, key=lambda record: record.seed)


def _run(record: Record, statistic: Statistic, software: dict[str, int], data: dict[str, int]) -> RunRow:
    def number(text: str, known: dict[str, int]) -> int | None:
        return known.setdefault(text, len(known) + 1) if text else None

    # Provenance is free text of whoever wrote the record.
    known = record.provenance
    return RunRow(
        record,
        record.status + (f" at {record.diverged_at:,}" if record.diverged_at is not None else ""),
        record.score(statistic),
        wall_time(record),
        number(software_of(record), software),
        number(_listed(known.get("data_fingerprints")), data),
        _device(known.get("device")),
        str(known.get("source_revision") or ""),
    )


def wall_time(record: Record) -> float | None:
    """Seconds that a run took; None where its record does not say."""
    seconds = record.provenance.get("seconds")
    known = [value for value in seconds.values() if usable(value)] if isinstance(seconds, Mapping) else []
    return float(sum(known)) if known else None


def software_of(record: Record) -> str:
    """``torch 2.13.0+cpu, numpy 1.26.4, …; Python 3.11.7; Linux-…``; empty where the record does not say."""
    known = record.provenance
    python = f"Python {known['python']}" if known.get("python") else ""
    return "; ".join(filter(None, [_listed(known.get("packages")), python, str(known.get("platform") or "")]))


def _listed(fields: Any) -> str:
    return ", ".join(f"{name} {value}" for name, value in fields.items()) if isinstance(fields, Mapping) else ""


def _device(known: Any) -> str:
    if not isinstance(known, Mapping):
        return ""
    return ", ".join(str(value) for field in ("type", "name", "precision") if (value := known.get(field)))
