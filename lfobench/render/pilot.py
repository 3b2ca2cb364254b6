"""A pilot out of records: which two methods of every task a comparison is planned for, and what a run of them costs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lfobench.contract.record import Record, usable
from lfobench.contract.statistic import Statistic
from lfobench.errors import UserError
from lfobench.render.building import build_table
from lfobench.render.columns import arrange_columns
from lfobench.render.table import Note, competes
from lfobench.stats.names import Scope
from lfobench.stats.sample import Sample


@dataclass(frozen=True)
class PilotCell:
    """One method on one task.

    Attributes:
        label: of its column.
        sample: its scores.
        seconds: that one more run keeps a worker busy, from the runs of this cell, else from the method's on other
            tasks; None where nobody has measured it.
    """

    label: str
    sample: Sample
    seconds: float | None


@dataclass(frozen=True)
class PilotTask:
    """The two methods of one task with the best means, best first."""

    task: str
    first: PilotCell
    second: PilotCell


@dataclass(frozen=True)
class Pilot:
    """What a plan is made from.

    Attributes:
        tasks: those with two methods.
        without: tasks with fewer.
        devices: where the runs were measured, e.g. ``cpu (AMD EPYC)``.
        beside: whether any of them was evaluated beside training.
        notes: of the records' table: what a score is, the source, the protocol.
    """

    tasks: tuple[PilotTask, ...]
    without: tuple[str, ...]
    devices: tuple[str, ...]
    beside: bool
    notes: tuple[Note, ...]


def read_pilot(
    records: Sequence[Record], statistic: Statistic, scope: Scope = "group", tasks: Sequence[str] = ()
) -> Pilot:
    """The pilot of `records`, whose best two methods in scope are compared on every task.

    Raises:
        UserError: there are no records, they must not share a table, or no task has two methods in scope.
    """
    table = build_table(records, statistic, tasks=tasks)
    columns = arrange_columns(records)
    found, without = [], []
    for _, row in table.rows():
        cells = {
            column: cell.sample
            for column, cell in zip(table.columns, row.cells, strict=True)
            if cell is not None and cell.sample is not None and column in columns and competes(column, scope)
        }
        best = sorted(cells, key=lambda column: -cells[column].summary.mean)[:2]
        if len(best) < 2:
            without.append(row.task)
            continue
        pair = [PilotCell(each.label, cells[each], _seconds(columns[each], row.task)) for each in best]
        found.append(PilotTask(row.task, *pair))
    if not found:
        among = " without access to expert actions" if scope == "group" else ""
        raise UserError(
            f"No task of these records has two methods{among}.",
            "Run a second method; --scope all takes all methods, --methods those that you name.",
        )
    return Pilot(
        tuple(found),
        tuple(without),
        tuple(sorted({_device(record) for record in records})),
        any(_beside(record) for record in records),
        tuple(note for note in table.notes if note.label in ("Score", "Source", "Protocol")),
    )


def run_seconds(record: Record) -> float | None:
    """Seconds that the record's run kept a worker busy: loading, then training and evaluation.

    Both add up where they take turns, as on a CPU. On CUDA other processes evaluate beside training, so the longer of
    the two counts. The time of seeds that trained together is shared equally among them. None where it is not known.
    """
    seconds = _mapping(record.provenance.get("seconds"))
    train = _number(seconds.get("train"))
    if train is None:
        return None
    evaluate, load = (_number(seconds.get(kind)) or 0.0 for kind in ("evaluate", "load"))
    spent = max(train, evaluate) if _beside(record) else train + evaluate
    return (spent + load) / max(1.0, _number(record.provenance.get("seeds_trained_together")) or 1.0)


def _seconds(records: Sequence[Record], task: str) -> float | None:
    here = list(_measured(record for record in records if record.task == task))
    measured = here or list(_measured(iter(records)))
    return sum(measured) / len(measured) if measured else None


def _measured(records: Iterator[Record]) -> Iterator[float]:
    return (seconds for record in records if (seconds := run_seconds(record)) is not None)


def _beside(record: Record) -> bool:
    return _mapping(record.provenance.get("device")).get("type") == "cuda"


def _device(record: Record) -> str:
    device = _mapping(record.provenance.get("device"))
    name = f" ({device['name']})" if device.get("name") else ""
    return f"{device.get('type', 'an unknown device')}{name}"


def _mapping(value: Any) -> Mapping[str, Any]:
    # Provenance is free text of whoever wrote the record.
    return value if isinstance(value, Mapping) else {}


def _number(value: Any) -> float | None:
    return float(value) if usable(value) and value >= 0 else None
