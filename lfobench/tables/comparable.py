"""Comparability: records share a table if they have one source, one protocol, and per row one set of conditions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lfobench.errors import UserError
from lfobench.record import Failure, Record, code_version
from lfobench.tables.table import Column
from lfobench.text import canonical_json, harmless

# What a column may change. Everything else in an identity is a condition that a row holds fixed.
COLUMN_FIELDS = frozenset(
    {"method", "method_version", "method_code", "preset", "config", "overrides", "set", "tuned", "expert_joins", "seed"}
)

_SEPARATELY = "Put the records of one of them into a folder of their own and make a table of each."
_REMEDIES = {"protocol.steps": "Choose one with --steps, which leaves out tasks of other lengths."}


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
        for field, one, two in leaf_differences(first.identity, other.identity):
            if field != "seed":
                _check_files(field, first, other)
                raise UserError(
                    f"{first.method} on {first.task} was run with {field} = {one} and with {two}.",
                    _REMEDIES.get(field, _SEPARATELY),
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
        for field, one, two in leaf_differences(_conditions(first), _conditions(record)):
            _check_files(field, first, record)
            raise UserError(
                f"On {record.task}, {first.method} was run with {field} = {one} and {record.method} with {two}.",
                _REMEDIES.get(field, _SEPARATELY),
            )


def _check_files(field: str, first: Record, second: Record) -> None:
    """Refuses records of different data files, by the names of the files, where `field` is one of their data."""
    top, _, part = field.partition(".")
    one, two = (_file_name(record, part) for record in (first, second))
    if top != "data" or one is None or two is None:
        return
    runs = f"{first.method} seed {first.seed} and {second.method} seed {second.seed}"
    files = f"{one} and {two}" if one != two else f"two files named {one}, of different content"
    raise UserError(f"On {first.task}, the {part} data of {runs} come from {files}.", _SEPARATELY)


def _file_name(record: Record, part: str) -> str | None:
    """Name of the file that a part of the data was read from; None where the record does not say."""
    # Provenance is free text of whoever wrote the record.
    files = record.provenance.get("data_files")
    file = files.get(part) if isinstance(files, Mapping) else None
    name = file.get("name") if isinstance(file, Mapping) else None
    return harmless(str(name)) if name else None


def _conditions(record: Record) -> dict[str, Any]:
    # Another processor's mathematics library can make other data from the same description.
    return fixed_fields(record) | {"data_fingerprints": record.provenance.get("data_fingerprints", {})}


def leaf_differences(
    one: Mapping[str, Any], two: Mapping[str, Any], prefix: str = ""
) -> Iterator[tuple[str, Any, Any]]:
    """Every leaf in which two nested mappings differ, as (dotted name, value, value)."""
    for field in sorted({*one, *two}):
        left, right = one.get(field), two.get(field)
        if isinstance(left, Mapping) and isinstance(right, Mapping):
            yield from leaf_differences(left, right, f"{prefix}{field}.")
        elif left != right:
            yield f"{prefix}{field}", left, right


@dataclass(frozen=True)
class _Variant:
    """A method as it was run. Two variants of one method never share a column.

    What tuning chose may differ from task to task; whether a method was tuned is what tells variants apart. `config` is
    empty unless the other fields do not tell the variants apart: a config may follow the task.
    """

    method: str
    version: str
    preset: str
    options: str
    tuned: bool
    config: str = ""


def arrange_columns(records: Sequence[Record], methods: Sequence[str] = ()) -> dict[Column, list[Record]]:
    """Records by column, in table order.

    Methods that see expert actions come first, as in the seed paper; within each group the methods named in
    `methods` come in that order, the others after them as they first appear.

    A column is labelled by its method alone where that is unique, else ``dilo:paper`` or ``dilo(tau=3)``.
    """
    variants = _by_variant(records)
    labels = _labels(variants)
    columns = {
        Column(
            label=labels[variant],
            method=variant.method,
            preset=variant.preset,
            kind="actions" if any(record.labels.sees_expert_actions for record in members) else "observations",
        ): members
        for variant, members in variants.items()
    }
    return {column: columns[column] for column in in_order(columns, methods)}


def in_order(columns: Iterable[Column], methods: Sequence[str]) -> list[Column]:
    """Methods that see expert actions first; within each group as `methods` names them, the others after them."""
    ranks = {method: rank for rank, method in enumerate(methods)}
    return sorted(columns, key=lambda column: (column.kind != "actions", ranks.get(column.method, len(ranks))))


def crashed_columns(failures: Sequence[Failure], records: Sequence[Record]) -> dict[Column, list[Failure]]:
    """Crashed runs by column, of the methods that left no record at all.

    A method that has records has its columns already: a crash of another version, preset or option belongs to another
    table.
    """
    known = {record.method for record in records}
    by_method: dict[str, list[Failure]] = {}
    for failure in failures:
        if failure.method not in known:
            by_method.setdefault(failure.method, []).append(failure)
    return {
        Column(
            label=harmless(" ".join(method.split())),
            method=method,
            preset=str(members[0].identity["preset"]),
            kind="actions" if any(each.labels.sees_expert_actions for each in members) else "observations",
        ): members
        for method, members in by_method.items()
    }


def column_of_failure(failure: Failure, columns: Mapping[Column, Sequence[Record]]) -> Column | None:
    """The column whose records were run as the failed run was, apart from task, seed and what follows the task."""
    for column, records in columns.items():
        if any(_variant(failure) == _variant(record) for record in records):
            same_task = [record for record in records if record.task == failure.task]
            if all(_config(record) == _config(failure) for record in same_task):
                return column
    return None


def fits_row(failure: Failure, records: Sequence[Record]) -> bool:
    """Whether the failed run's conditions are those of its row, where it has one; else it belongs to another table."""
    row = next((record for record in records if record.task == failure.task), None)
    return row is None or fixed_fields(row) == fixed_fields(failure)


def _by_variant(records: Sequence[Record]) -> dict[_Variant, list[Record]]:
    configs: dict[tuple[_Variant, str], set[str]] = {}
    for record in records:
        configs.setdefault((_variant(record), record.task), set()).add(_config(record))
    ambiguous = {variant for (variant, _), found in configs.items() if len(found) > 1}

    variants: dict[_Variant, list[Record]] = {}
    for record in records:
        variant = _variant(record)
        if variant in ambiguous:
            variant = _variant(record, _config(record))
        variants.setdefault(variant, []).append(record)
    return variants


def _variant(record: Record | Failure, config: str = "") -> _Variant:
    identity = record.identity
    return _Variant(
        method=record.method,
        version=code_version(identity) or str(identity["method_version"]),
        preset=str(identity["preset"]),
        options=canonical_json(identity.get("set", {})),
        tuned=bool(identity.get("tuned")),
        config=config,
    )


def _config(record: Record | Failure) -> str:
    return canonical_json(record.identity["config"])


def _labels(variants: Mapping[_Variant, Sequence[Record]]) -> dict[_Variant, str]:
    labels = {}
    for variant, members in variants.items():
        siblings = [other for other in variants if other.method == variant.method]
        label = " ".join(variant.method.split())
        if len({other.preset for other in siblings}) > 1:
            label += f":{variant.preset}"
        if len({other.version for other in siblings}) > 1:
            label += f"@{variant.version}"
        fields = _distinguishing_fields(variant, members[0].identity, variants)
        shown = [f"{field}={canonical_json(value)}" for field, value in fields.items()]
        if variant.tuned and not all(other.tuned for other in siblings):
            shown.insert(0, "tuned")
        if shown:
            label += f"({', '.join(shown)})"
        labels[variant] = harmless(label)
    return labels


def _distinguishing_fields(
    variant: _Variant, identity: Mapping[str, Any], variants: Mapping[_Variant, Sequence[Record]]
) -> dict[str, Any]:
    """Fields of the config in which a variant differs from the others of its method and preset."""
    siblings = {
        other: members[0].identity
        for other, members in variants.items()
        if (other.method, other.preset) == (variant.method, variant.preset)
    }
    shown = _not_shared(identity.get("set", {}), [other.get("set", {}) for other in siblings.values()])
    if variant.config:
        rivals = [other["config"] for sibling, other in siblings.items() if sibling.config]
        shown |= _not_shared(identity["config"], rivals)
    return shown


def _not_shared(fields: Mapping[str, Any], others: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Fields that some of `others` lack or give another value, as JSON tells values apart (1 is not 1.0)."""
    return {
        field: value
        for field, value in fields.items()
        if any(field not in other or canonical_json(other[field]) != canonical_json(value) for other in others)
    }
