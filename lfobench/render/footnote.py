"""The footnote: everything a reader must know to judge the numbers above it, generated from the records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from lfobench.contract.record import Record, canonical_json
from lfobench.contract.statistic import Statistic
from lfobench.render.cell_text import DIVERGED, FAILED, MISSING
from lfobench.render.highlight_note import highlight_notes
from lfobench.render.table import Column, Note, Table
from lfobench.stats.comparison import PAIRED

Columns = Mapping[Column, Sequence[Record]]

STATISTICS: dict[str, str] = {
    "last5": "mean of the last 5 evaluations",
    "last": "last evaluation",
    "best": "best evaluation, picked by the score it reports and therefore optimistic",
    "at": "evaluation at step {step:,}",
}


def footnote(table: Table, columns: Columns) -> tuple[Note, ...]:
    """The notes of `table`, whose `columns` hold the given records."""
    records = [record for members in columns.values() for record in members]
    return (
        _score(table.statistic, records),
        _data(table.source, records),
        _protocol(table.protocol, columns, records),
        _simulator(records),
        *_precision(records),
        seeds_note(table),
        *highlight_notes(table),
        *_configurations(table.protocol, columns),
        *_demonstration(table),
        *_diverged(columns),
        *_failed(table),
        *_missing(table),
        *_warnings(columns),
    )


def _score(statistic: Statistic, records: Sequence[Record]) -> Note:
    text = (
        "normalised return, 100 · (return − random) / (expert − random); mean ± sample standard deviation "
        f"over seeds. Each seed counts as the {STATISTICS[statistic.name].format(step=statistic.step)}"
    )
    fewest = min((len(record.evaluations) for record in records if record.status == "finished"), default=5)
    if statistic.name == "last5" and fewest < 5:
        text += f" (of all of them where a run has fewer; the shortest has {fewest})"
    return Note("Score", f"{text}.")


def _data(source: str, records: Sequence[Record]) -> Note:
    def values(field: str) -> str:
        return _either(record.identity["recipe"][field] for record in records)

    return Note(
        "Source",
        f"{source}. Offline data: {values('offline_transitions')} transitions and, with their actions, "
        f"{values('expert_trajectories')} expert trajectories. "
        f"Expert data: {values('demonstration_rows')} rows, observations only.",
    )


def _protocol(name: str, columns: Columns, records: Sequence[Record]) -> Note:
    protocol = records[0].identity["protocol"]
    steps = _either(record.identity["protocol"]["steps"] for record in records)
    assigned = any(record.identity["protocol"]["steps_assigned"] for record in records)
    batches = _per_column(
        columns,
        lambda record: (
            [f"batch size {record.identity['config']['batch_size']}"]
            if "batch_size" in record.identity["config"]
            else []
        ),
    )
    return Note(
        "Protocol",
        f"{name}: {steps} gradient steps{' (set with --steps)' if assigned else ''}"
        f"{f', {batches}' if batches else ''}; "
        f"every {protocol['evaluation_every']:,} steps an evaluation of {protocol['evaluation_episodes']} "
        "episodes, from the same starts for every method and seed.",
    )


def _simulator(records: Sequence[Record]) -> Note:
    versions: dict[str, list[str]] = {}
    for record in records:
        for package, version in record.identity["simulator"].items():
            versions.setdefault(package, []).append(str(version))
    environments = sorted({str(record.identity["environment"]["id"]) for record in records})
    packages = ", ".join(f"{package} {_either(found)}" for package, found in versions.items())
    return Note("Simulator", f"{packages}; {', '.join(environments)}.")


def _precision(records: Sequence[Record]) -> Iterator[Note]:
    """Said where a record's products were not float32, as they are on a CPU unless asked otherwise."""
    devices = [record.provenance.get("device") for record in records]
    kinds = {str(device.get("precision", "float32")) if isinstance(device, dict) else "float32" for device in devices}
    if kinds != {"float32"}:
        yield Note("Precision", f"matrix products in {' and '.join(sorted(kinds))}.")


def seeds_note(table: Table) -> Note:
    """How many seeds stand behind a cell, and which."""
    cells = [(row, column, cell) for row, column, cell in table.cells() if cell is not None and column.run_here]
    sizes = [len(cell.seeds) for _, _, cell in cells]
    most, fewest = max(sizes), min(sizes)
    if fewest < most:
        short = ", ".join(
            f"{column.label} on {row.task} ({len(cell.seeds)})" for row, column, cell in cells if len(cell.seeds) < most
        )
        return Note("Seeds", f"n = {fewest} to {most} per cell, unequal. Fewer than {most}: {short}.")
    choices = {cell.seeds for _, _, cell in cells}
    which = f"seeds {', '.join(map(str, choices.pop()))}" if len(choices) == 1 else "different seeds per cell"
    untested = "" if table.rule.test in PAIRED else " and cannot be tested"
    spread = "" if most > 1 else f"; one seed has no standard deviation{untested}"
    return Note("Seeds", f"n = {most} per cell ({which}){spread}.")


def _configurations(protocol: str, columns: Columns) -> Iterator[Note]:
    presets = _per_column(columns, lambda record: [str(record.identity["preset"])])
    yield Note("Presets", f"{presets}.")
    stated = [
        f"{column.label}: {', '.join(facts)}" for column, records in columns.items() if (facts := _stated(records))
    ]
    if stated:
        yield Note("Configured", f"{'; '.join(stated)}.")
    for label, field in ((f"Set by protocol {protocol}", "overrides"), ("Set by hand", "set")):
        settings = [
            f"{column.label}: {', '.join(_settings(records, field))}"
            for column, records in columns.items()
            if _settings(records, field)
        ]
        if settings:
            yield Note(label, f"{'; '.join(settings)}.")


def _settings(records: Sequence[Record], field: str) -> list[str]:
    return _assignments(record.identity.get(field, {}) for record in records)


def _stated(records: Sequence[Record]) -> list[str]:
    """What the methods want every reader to know of their configuration."""
    return _assignments({name: record.identity["config"][name] for name in record.labels.stated} for record in records)


def _assignments(fields: Iterable[Mapping[str, Any]]) -> list[str]:
    values: dict[str, list[Any]] = {}
    for one in fields:
        for name, value in one.items():
            values.setdefault(name, []).append(value)
    return [f"{name} = {_either(found)}" for name, found in values.items()]


def _diverged(columns: Columns) -> Iterator[Note]:
    runs = [
        f"{column.label} on {record.task}, seed {record.seed}"
        + (f" (step {record.diverged_at:,})" if record.diverged_at is not None else "")
        for column, records in columns.items()
        for record in records
        if record.status == "diverged"
    ]
    if runs:
        yield Note("Diverged", f"{DIVERGED}k marks k diverged seeds, counted as score 0: {'; '.join(runs)}.")


def _demonstration(table: Table) -> Iterator[Note]:
    if any(column.kind == "expert" for column in table.columns):
        yield Note("Demonstration", "the score of the expert trajectory that the methods observe.")


def _failed(table: Table) -> Iterator[Note]:
    runs = [
        f"{column.label} on {row.task}, {'seed' if len(cell.failed_seeds) == 1 else 'seeds'} "
        f"{', '.join(map(str, cell.failed_seeds))}"
        for row, column, cell in table.cells()
        if cell is not None and cell.failed_seeds
    ]
    if runs:
        yield Note(
            "Failed",
            f"{FAILED}k marks k seeds that crashed and have no score; they are not in n: {'; '.join(runs)}. "
            "The command that made the table's records tries them again.",
        )


def _missing(table: Table) -> Iterator[Note]:
    missing = [
        f"{column.label} on {row.task}" for row, column, cell in table.cells() if cell is None and column.run_here
    ]
    if missing:
        yield Note("Missing", f"{MISSING} marks cells without any record: {', '.join(missing)}.")


def _warnings(columns: Columns) -> Iterator[Note]:
    concerned: dict[tuple[str, str], dict[str, None]] = {}
    for column, records in columns.items():
        for record in records:
            for warning in record.warnings:
                concerned.setdefault((warning.what, warning.remedy), {})[column.label] = None
    for (what, remedy), labels in concerned.items():
        yield Note("Warning", f"{what} {remedy} ({', '.join(labels)})")


def _per_column(columns: Columns, describe: Callable[[Record], list[str]]) -> str:
    """What `describe` says of each column: once if all agree, else each value with its columns."""
    said: dict[str, dict[str, None]] = {}
    for column, records in columns.items():
        for record in records:
            for value in describe(record):
                said.setdefault(value, {})[column.label] = None
    if len(said) == 1:
        return next(iter(said))
    return ", ".join(f"{value} ({', '.join(labels)})" for value, labels in said.items())


def _either(values: Iterable[Any]) -> str:
    """Distinct values in ascending order where they are numbers: ``300,000 or 500,000``."""
    distinct = list({canonical_json(value): value for value in values}.values())
    if all(isinstance(value, int) and not isinstance(value, bool) for value in distinct):
        return " or ".join(f"{value:,}" for value in sorted(distinct))
    return " or ".join(str(value) for value in distinct)
