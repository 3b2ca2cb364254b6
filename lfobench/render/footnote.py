"""The footnote: everything a reader must know to judge the numbers above it, generated from the records."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from lfobench.contract.environment import ActionBox
from lfobench.contract.record import Record
from lfobench.render.cell_text import DIVERGED, FAILED, MISSING
from lfobench.render.highlight_note import highlight_notes
from lfobench.render.score_notes import score_notes
from lfobench.render.table import Note, Table
from lfobench.render.training_notes import counts_trajectories, data_note, protocol_note, sees_the_mix, tuning_notes
from lfobench.render.wording import Columns, assignments, either, per_column
from lfobench.stats.comparison import PAIRED


def footnote(table: Table, columns: Columns) -> tuple[Note, ...]:
    """The notes of `table`, whose `columns` hold the given records."""
    records = [record for members in columns.values() for record in members]
    return (
        *score_notes(table, records),
        data_note(table.source, records),
        protocol_note(table.protocol, columns, records),
        _simulator(records),
        *_actions(records),
        *_precision(records),
        seeds_note(table),
        *highlight_notes(table),
        *_configurations(_layer(table.protocol, records), columns),
        *tuning_notes(columns),
        *_demonstration(table, records),
        *_diverged(table, columns),
        *_failed(table),
        *_missing(table),
        *_warnings(columns),
    )


def _simulator(records: Sequence[Record]) -> Note:
    versions: dict[str, list[str]] = {}
    for record in records:
        for package, version in record.identity["simulator"].items():
            versions.setdefault(package, []).append(str(version))
    environments = sorted({_environment(record.identity["environment"]) for record in records})
    packages = ", ".join(f"{package} {either(found)}" for package, found in versions.items())
    return Note("Simulator", f"{packages}; {', '.join(environments)}.")


def _actions(records: Sequence[Record]) -> Iterator[Note]:
    """Said of environments whose actions are not in [-1, 1]."""
    boxes = {
        f"{_environment(record.identity['environment'])} takes {ActionBox.from_identity(box).scaling}"
        for record in records
        if (box := record.identity.get("action_box"))
    }
    if boxes:
        yield Note("Actions", f"{'; '.join(sorted(boxes))}.")


def _environment(environment: Mapping[str, Any]) -> str:
    # An id may name the module that registers it before a colon.
    name = str(environment["id"]).rpartition(":")[2]
    arguments = ", ".join(assignments([environment.get("arguments", {})]))
    return f"{name} ({arguments})" if arguments else name


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
    spread = "" if most > 1 or table.counts else f"; one seed has no standard deviation{untested}"
    return Note("Seeds", f"n = {most} per cell ({which}){spread}.")


def _layer(protocol: str, records: Sequence[Record]) -> str:
    """Who changes a method's configuration besides the user: tasks of some kinds of data may, too."""
    by_task = any(counts_trajectories(record) or not sees_the_mix(record) for record in records)
    return f"protocol {protocol}{' or task' if by_task else ''}"


def _configurations(layer: str, columns: Columns) -> Iterator[Note]:
    presets = per_column(columns, lambda record: [str(record.identity["preset"])])
    yield Note("Presets", f"{presets}.")
    stated = [
        f"{column.label}: {', '.join(facts)}" for column, records in columns.items() if (facts := _stated(records))
    ]
    if stated:
        yield Note("Configured", f"{'; '.join(stated)}.")
    for label, field in ((f"Set by {layer}", "overrides"), ("Set by hand", "set")):
        settings = [
            f"{column.label}: {', '.join(_settings(records, field))}"
            for column, records in columns.items()
            if _settings(records, field)
        ]
        if settings:
            yield Note(label, f"{'; '.join(settings)}.")


def _settings(records: Sequence[Record], field: str) -> list[str]:
    return assignments(record.identity.get(field, {}) for record in records)


def _stated(records: Sequence[Record]) -> list[str]:
    """What the methods want every reader to know of their configuration."""
    return assignments({name: record.identity["config"][name] for name in record.labels.stated} for record in records)


def _diverged(table: Table, columns: Columns) -> Iterator[Note]:
    runs = [
        f"{column.label} on {record.task}, seed {record.seed}"
        + (f" (step {record.diverged_at:,})" if record.diverged_at is not None else "")
        for column, records in columns.items()
        for record in records
        if record.status == "diverged"
    ]
    if runs:
        counted = "every episode of which counts as a failure" if table.counts else "counted as score 0"
        yield Note("Diverged", f"{DIVERGED}k marks k diverged seeds, {counted}: {'; '.join(runs)}.")


def _demonstration(table: Table, records: Sequence[Record]) -> Iterator[Note]:
    if not any(column.kind == "expert" for column in table.columns):
        return
    score = "success rate in %" if table.success_rates else "score"
    recorded = any(map(counts_trajectories, records))
    shown = f"mean {score} of the expert trajectories" if recorded else f"{score} of the expert trajectory"
    yield Note("Demonstration", f"the {shown} that the methods observe.")


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
