"""Conditions of two folders: in which fields the runs of their common cells differ, and which of them may."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from lfobench.errors import UserError, unknown_name
from lfobench.record import Record
from lfobench.tables.comparable import leaf_differences
from lfobench.text import canonical_json

SOFTWARE = frozenset({"schema", "method_version", "method_code", "config", "overrides", "tuned"})
"""Fields of an identity that another version of the software may change."""

MATCHED = frozenset({"method", "preset", "set", "task", "seed"})
"""Fields that say which cell and which run of it; seeds are compared as samples, not one by one."""

_LONGEST = 24

FINGERPRINTS = "data_fingerprints"

_MACHINE = (("packages",), ("source_revision",), ("device", "type"), ("device", "precision"))


@dataclass(frozen=True)
class CellRecords:
    """The records of one cell in both folders, and what to call the cell: ``dilo on hopper-random-expert``."""

    name: str
    reference: Sequence[Record]
    subject: Sequence[Record]


@dataclass(frozen=True)
class Difference:
    """One field in which two folders differ.

    Attributes:
        field: dotted, as in the identity; of a `machine` difference as in the provenance.
        kind: `software`: may differ; `condition`: may differ only where it was allowed; `machine`: where it was run,
            which may differ and may change the last digits of a number.
        reference: its value in the first folder, as JSON.
        subject: in the second.
        cells: names of the cells concerned; empty for `machine`.
    """

    field: str
    kind: Literal["software", "condition", "machine"]
    reference: str
    subject: str
    cells: tuple[str, ...] = ()


def differences(cells: Sequence[CellRecords]) -> list[Difference]:
    """Everything that differs in any cell, conditions first."""
    found: dict[tuple[str, str, str], Difference] = {}
    for cell in cells:
        # Records of one cell differ in the seed alone, and those of one task share their data.
        for field, one, two in leaf_differences(_described(cell.reference[0]), _described(cell.subject[0])):
            kind: Literal["software", "condition"] = "software" if _top(field) in SOFTWARE else "condition"
            new = Difference(field, kind, _text(one), _text(two))
            known = found.setdefault((field, new.reference, new.subject), new)
            found[field, new.reference, new.subject] = replace(known, cells=(*known.cells, cell.name))
    return [*sorted(found.values(), key=lambda each: (each.kind, each.field)), *_machines(cells)]


def refuse_other_conditions(cells: Sequence[CellRecords], found: Iterable[Difference], allowed: Sequence[str]) -> None:
    """Refuses conditions that differ, unless `allowed` names the field or one that it lies in.

    Raises:
        UserError: such a difference, or an allowed field that no record has.
    """
    known = {FINGERPRINTS}.union(
        *(record.identity for cell in cells for record in (cell.reference[0], cell.subject[0]))
    )
    for name in allowed:
        if _top(name) not in known:
            raise unknown_name("field in --allow", name, known)
    refused = [
        each
        for each in found
        if each.kind == "condition" and not any(f"{each.field}.".startswith(f"{name}.") for name in allowed)
    ]
    if not refused:
        return
    first = refused[0]
    fields = list(dict.fromkeys(each.field for each in refused))
    others = f" Other fields differ too: {', '.join(fields[1:])}." if fields[1:] else ""
    raise UserError(
        f"The folders were not run under the same conditions: for {first.cells[0]}, {first.field} is "
        f"{shortened(first.reference)} in the first and {shortened(first.subject)} in the second.{others}",
        f"If that is what you want to compare, add {' '.join(f'--allow {name}' for name in _shortest(fields))}.",
    )


def shortened(value: str) -> str:
    """A value that is too long for a line, such as a hash, cut off; the JSON holds it whole."""
    return value if len(value) <= _LONGEST else f"{value[: _LONGEST - 1]}…"


def _shortest(fields: Sequence[str]) -> list[str]:
    """The fewest names that allow all of these: a field, or what several of them lie in."""
    tops = [_top(field) for field in fields]
    return list(dict.fromkeys(top if tops.count(top) > 1 else field for field, top in zip(fields, tops, strict=True)))


def _top(field: str) -> str:
    return field.partition(".")[0]


def _described(record: Record) -> dict[str, Any]:
    fields = {field: value for field, value in record.identity.items() if field not in MATCHED}
    return fields | {FINGERPRINTS: record.provenance.get(FINGERPRINTS, {})}


def _machines(cells: Sequence[CellRecords]) -> Iterator[Difference]:
    one = _provenance([record for cell in cells for record in cell.reference])
    two = _provenance([record for cell in cells for record in cell.subject])
    for field in sorted({*one, *two}):
        before, after = (" and ".join(sorted(values.get(field, {"none"}))) for values in (one, two))
        if before != after:
            yield Difference(field, "machine", before, after)


def _provenance(records: Iterable[Record]) -> dict[str, set[str]]:
    """Values that occur of the fields of the machine that may matter, by dotted name."""
    values: dict[str, set[str]] = {}
    for record in records:
        for place in _MACHINE:
            found: Any = record.provenance
            for step in place:
                # Provenance is free text of whoever wrote the record.
                found = found.get(step) if isinstance(found, Mapping) else None
            leaves = found if isinstance(found, Mapping) else {} if found is None else {"": found}
            for name, value in leaves.items():
                values.setdefault(".".join(filter(None, [*place, name])), set()).add(str(value))
    return values


def _text(value: Any) -> str:
    return "none" if value is None else canonical_json(value)
