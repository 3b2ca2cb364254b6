"""Which records may share a table: one source, one protocol, and per row one set of conditions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from lfobench.contract.failure import Failure
from lfobench.contract.record import Record
from lfobench.errors import UserError

# What a column may change. Everything else in an identity is a condition that a row holds fixed.
COLUMN_FIELDS = frozenset(
    {"method", "method_version", "method_code", "preset", "config", "overrides", "set", "tuned", "expert_joins", "seed"}
)

_SEPARATELY = "Put the records of one of them into a folder of their own and make a table of each."
_WAYS_OUT = {"protocol.steps": "Choose one with --steps, which leaves out tasks of other lengths."}


def check_unmixed(records: Sequence[Record]) -> None:
    """Refuses records that must not share a table.

    Raises:
        UserError: two sources, two protocols, or two conditions (data, simulator, steps, …) for one task.
    """
    _check_sources(records)
    _check_protocols(records)
    _check_tasks(records)


def check_cell(records: Sequence[Record]) -> None:
    """Refuses records of one cell that are not the same run apart from the seed, or that repeat a seed.

    Raises:
        UserError: the records differ in something other than the seed, or a seed occurs twice.
    """
    first = records[0]
    for other in records[1:]:
        for field, one, two in differing_leaves(first.identity, other.identity):
            if field != "seed":
                raise UserError(
                    f"{first.method} on {first.task} was run with {field} = {one} and with {two}.",
                    _WAYS_OUT.get(field, _SEPARATELY),
                )
    seeds = [record.seed for record in records]
    repeated = next((seed for seed in seeds if seeds.count(seed) > 1), None)
    if repeated is not None:
        raise UserError(
            f"{first.method} on {first.task} has two records for seed {repeated}.",
            "Remove one of the copies: a run leaves exactly one record.",
        )


def fixed_fields(record: Record | Failure) -> dict[str, Any]:
    """The fields of an identity that a row holds fixed."""
    return {field: value for field, value in record.identity.items() if field not in COLUMN_FIELDS}


def _check_sources(records: Sequence[Record]) -> None:
    sources = sorted({str(record.identity["source"]) for record in records})
    if len(sources) > 1:
        raise UserError(
            f"One table must not mix sources; these records come from {' and '.join(sources)}.",
            f"Choose one with {' or '.join(f'--source {name}' for name in sources)}.",
        )


def _check_protocols(records: Sequence[Record]) -> None:
    names = sorted({str(record.identity["protocol"]["name"]) for record in records})
    if len(names) > 1:
        raise UserError(
            f"One table must not mix protocols; these records come from {' and '.join(names)}.",
            f"Choose one with {' or '.join(f'--protocol {name}' for name in names)}.",
        )
    # Tasks whose data is counted in trajectories have budgets of their own under every protocol.
    alike = [record for record in records if "offline_trajectories" not in record.identity["recipe"]]
    for field in ("evaluation_every", "evaluation_episodes"):
        values = sorted({record.identity["protocol"][field] for record in alike})
        if len(values) > 1:
            raise UserError(
                f"Protocol '{names[0]}' was run with {field} = {' and '.join(map(str, values))}.", _SEPARATELY
            )


def _check_tasks(records: Sequence[Record]) -> None:
    firsts: dict[str, Record] = {}
    for record in records:
        first = firsts.setdefault(record.task, record)
        for field, one, two in differing_leaves(_conditions(first), _conditions(record)):
            raise UserError(
                f"On {record.task}, {first.method} was run with {field} = {one} and {record.method} with {two}.",
                _WAYS_OUT.get(field, _SEPARATELY),
            )


def _conditions(record: Record) -> dict[str, Any]:
    # Another processor's mathematics library can make other data from the same description.
    return fixed_fields(record) | {"data_fingerprints": record.provenance.get("data_fingerprints", {})}


def differing_leaves(
    one: Mapping[str, Any], two: Mapping[str, Any], prefix: str = ""
) -> Iterator[tuple[str, Any, Any]]:
    """Every leaf in which two nested mappings differ, as (dotted name, value, value)."""
    for field in sorted({*one, *two}):
        left, right = one.get(field), two.get(field)
        if isinstance(left, Mapping) and isinstance(right, Mapping):
            yield from differing_leaves(left, right, f"{prefix}{field}.")
        elif left != right:
            yield f"{prefix}{field}", left, right
