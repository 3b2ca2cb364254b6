"""Which cell is held against which: two methods of one folder by task, two folders by method and task."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from lfobench.contract.failure import Failure
from lfobench.contract.record import Record
from lfobench.contract.statistic import Statistic
from lfobench.errors import UserError, unknown_name
from lfobench.render.columns import arrange_columns
from lfobench.render.conditions import check_unmixed
from lfobench.render.differing import CellRecords, Difference, differences, refuse_other_conditions
from lfobench.render.sides import Cells, Found, Side, Variant, cells_of, merged_notes, variant_of
from lfobench.render.table import Cell, Column, Note
from lfobench.stats.highlight import DEFAULT_RULE, Rule
from lfobench.stats.sample import Sample

CellName: TypeAlias = tuple[str, str]
"""(task, column label); no label where two methods are compared, since each cell then has both."""


@dataclass(frozen=True)
class Pair:
    """One cell on both sides; both have scores.

    Attributes:
        subject: judged.
        reference: what it is held against.
        identical_runs: runs of one identity whose evaluations are equal on both sides, bit for bit.
        changed_runs: runs of one identity whose evaluations are not.
    """

    subject: Cell
    reference: Cell
    identical_runs: int = 0
    changed_runs: int = 0

    @property
    def identical(self) -> bool:
        """Whether both sides hold the same runs and nothing else, so that there is nothing to test."""
        return self.identical_runs == len(self.subject.seeds) == len(self.reference.seeds)

    @property
    def samples(self) -> tuple[Sample, Sample]:
        """The subject's scores and the reference's."""
        assert self.subject.sample is not None
        assert self.reference.sample is not None
        return self.subject.sample, self.reference.sample


@dataclass(frozen=True)
class Pairing:
    """All cells of a comparison.

    Attributes:
        kind: what the sides are.
        subject: the side that is judged: the first method, or the second folder.
        reference: the other.
        pairs: the cells of both.
        only_subject: cells that the reference lacks.
        only_reference: cells that the subject lacks.
        crashed: those of `only_reference` where the subject was tried and every seed crashed.
        differences: what two folders differ in besides; refused ones never get here.
        notes: what their tables' footnotes say.
    """

    kind: Literal["methods", "folders"]
    subject: Side
    reference: Side
    pairs: Mapping[CellName, Pair]
    only_subject: tuple[CellName, ...]
    only_reference: tuple[CellName, ...]
    notes: tuple[Note, ...]
    crashed: frozenset[CellName] = frozenset()
    differences: tuple[Difference, ...] = ()

    @property
    def unit(self) -> str:
        """What one cell is called: two methods differ on a task, two folders in a cell."""
        return "task" if self.kind == "methods" else "cell"


def name_of(cell: CellName) -> str:
    """``dilo on hopper-random-expert``, or the task alone."""
    task, label = cell
    return f"{label} on {task}" if label else task


def pair_methods(
    records: Sequence[Record],
    failures: Sequence[Failure],
    first: str,
    second: str,
    statistic: Statistic,
    tasks: Sequence[str] = (),
    rule: Rule = DEFAULT_RULE,
) -> Pairing:
    """The first method against the second, on every task; a method with several columns is named by its column.

    The cells hold what the test of `rule` compares.

    Raises:
        UserError: an unknown or an ambiguous name, one method against itself, records that must not share a table, or
            no task of both.
    """
    columns = arrange_columns(records)
    one, two = _column(first, columns), _column(second, columns)
    if one == two:
        raise UserError(f"'{first}' and '{second}' are the same records.", "Name two methods.")
    check_unmixed([*columns[one], *columns[two]])
    subject, reference = (
        Side(column.label, column.label, columns[column], [each for each in failures if each.method == column.method])
        for column in (one, two)
    )
    cells, notes = zip(*(cells_of(side, statistic, tasks, rule) for side in (subject, reference)), strict=True)
    by_task: list[Cells] = [{(task, ()): found for (task, _), found in each.items()} for each in cells]
    return _paired("methods", subject, reference, by_task[0], by_task[1], {}, merged_notes(subject, reference, *notes))


def pair_folders(
    reference: Side,
    subject: Side,
    statistic: Statistic,
    tasks: Sequence[str] = (),
    allowed: Sequence[str] = (),
    rule: Rule = DEFAULT_RULE,
) -> Pairing:
    """The second folder's cells against the first's, which hold what the test of `rule` compares.

    Raises:
        UserError: no cell of both, two variants of one cell in a folder, records of a folder that must not share a
            table, or conditions that differ and are not `allowed`.
    """
    theirs, their_notes = cells_of(reference, statistic, tasks, rule)
    ours, our_notes = cells_of(subject, statistic, tasks, rule)
    labels = _labels([*ours.values(), *(found for key, found in theirs.items() if key not in ours)])
    pairing = _paired(
        "folders", subject, reference, ours, theirs, labels, merged_notes(subject, reference, our_notes, their_notes)
    )
    common = [
        CellRecords(f"{labels[found.records[0].identity_hash]} on {key[0]}", theirs[key].records, found.records)
        for key, found in ours.items()
        if key in theirs
    ]
    differing = differences(common)
    refuse_other_conditions(common, differing, allowed)
    tried = {(failure.task, variant_of(failure)) for failure in subject.failures}
    crashed = frozenset(
        (key[0], labels[each.records[0].identity_hash])
        for key, each in theirs.items()
        if key not in ours and key in tried
    )
    return replace(pairing, differences=tuple(differing), crashed=crashed)


def _column(name: str, columns: Iterable[Column]) -> Column:
    every = list(columns)
    named = [column for column in every if column.label == name] or [
        column for column in every if column.method == name
    ]
    if not named:
        raise unknown_name("method among these records", name, {column.label for column in every})
    if len(named) > 1:
        labels = " or ".join(f"'{column.label}'" for column in named)
        raise UserError(f"{name} was run in more than one way.", f"Name one: {labels}.")
    return named[0]


def _labels(found: Iterable[Found]) -> dict[str, str]:
    """Column label by identity hash, unique among all these cells."""
    columns = arrange_columns([record for each in found for record in each.records])
    return {record.identity_hash: column.label for column, records in columns.items() for record in records}


def _paired(
    kind: Literal["methods", "folders"],
    subject: Side,
    reference: Side,
    ours: Cells,
    theirs: Cells,
    labels: Mapping[str, str],
    notes: tuple[Note, ...],
) -> Pairing:
    def name(key: tuple[str, Variant]) -> CellName:
        return key[0], labels.get((ours.get(key) or theirs[key]).records[0].identity_hash, "")

    common = [key for key in ours if key in theirs]
    if not common:
        raise UserError(
            f"{subject.name} and {reference.name} have no cell in common: there is {_listed(map(name, ours))} on one "
            f"side and {_listed(map(name, theirs))} on the other.",
            "Run the same tasks for both.",
        )
    return Pairing(
        kind=kind,
        subject=subject,
        reference=reference,
        pairs={name(key): _pair(ours[key], theirs[key]) for key in common},
        only_subject=tuple(name(key) for key in ours if key not in theirs),
        only_reference=tuple(name(key) for key in theirs if key not in ours),
        notes=notes,
    )


def _listed(cells: Iterable[CellName]) -> str:
    names = [name_of(cell) for cell in cells]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _pair(ours: Found, theirs: Found) -> Pair:
    known = {record.identity_hash: record for record in theirs.records}
    same = [
        _outcome(record) == _outcome(other) for record in ours.records if (other := known.get(record.identity_hash))
    ]
    return Pair(ours.cell, theirs.cell, identical_runs=sum(same), changed_runs=len(same) - sum(same))


def _outcome(record: Record) -> tuple[object, ...]:
    return record.status, record.diverged_at, record.evaluations, record.further
