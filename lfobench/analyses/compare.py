"""Comparisons: two methods of one folder task by task, or two folders cell by cell, and the verdict on each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from lfobench.analyses.conditions import CellRecords, Difference, differences, refuse_other_conditions
from lfobench.errors import UserError, unknown_name
from lfobench.record import Failure, Record, Warning
from lfobench.score import Statistic
from lfobench.stats.contrast import Comparison, Contrast, Outcome, best_p, contrast, scores_compared
from lfobench.stats.highlight import DEFAULT_RULE, Rule
from lfobench.stats.tests import Sample
from lfobench.tables.building import build_table
from lfobench.tables.comparable import arrange_columns, check_unmixed
from lfobench.tables.footnote import TESTS, unit
from lfobench.tables.table import Cell, Column, Note
from lfobench.text import canonical_json, counted

Variant: TypeAlias = tuple[str, ...]
"""Method, preset and settings by hand, not the version: columns of two folders that share them are compared."""

_SHARED_NOTES = ("Score", "Episodes", "Source", "Protocol", "Simulator", "Precision", "Diverged", "Failed")


@dataclass(frozen=True)
class NamedRuns:
    """Runs that are compared: a folder's, or those of a method's column.

    Attributes:
        name: as the user called it.
        heading: short, over its numbers.
        records: its runs.
        failures: its crashed runs.
    """

    name: str
    heading: str
    records: Sequence[Record]
    failures: Sequence[Failure] = ()


@dataclass(frozen=True)
class CellRuns:
    """A cell and the records behind it."""

    cell: Cell
    records: Sequence[Record]


Cells: TypeAlias = Mapping[tuple[str, Variant], CellRuns]


def cells_of(runs: NamedRuns, statistic: Statistic, tasks: Sequence[str], rule: Rule) -> tuple[Cells, tuple[Note, ...]]:
    """The cells that have scores, in table order, and the footnote of their table.

    Raises:
        UserError: records that must not share a table, or two variants of one cell that only their versions or
            configurations tell apart.
    """
    try:
        # Only whether successes are counted matters: a comparison has no highlights, which other tests could refuse.
        shown = Rule("fisher") if rule.test == "fisher" else DEFAULT_RULE
        table = build_table(runs.records, statistic, shown, tasks, failures=runs.failures)
    except UserError as error:
        raise UserError(f"{runs.name}: {error.problem}", error.remedy) from error
    columns = arrange_columns(runs.records)
    cells: dict[tuple[str, Variant], CellRuns] = {}
    for row, column, cell in table.cells():
        if cell is None or cell.sample is None or column not in columns:
            continue
        records = [record for record in columns[column] if record.task == row.task]
        key = (row.task, variant_of(records[0]))
        if key in cells:
            raise UserError(
                f"{runs.name} holds {column.method} on {row.task} in two versions or configurations.",
                "Put the records of one of them into a folder of their own.",
            )
        cells[key] = CellRuns(cell, records)
    return cells, table.notes


def variant_of(run: Record | Failure) -> Variant:
    """The variant that a run belongs to."""
    return run.method, str(run.identity["preset"]), canonical_json(run.identity["set"])


def merged_notes(
    subject: NamedRuns, reference: NamedRuns, ours: Sequence[Note], theirs: Sequence[Note]
) -> tuple[Note, ...]:
    """Notes of both tables: once where they agree, else each with the heading of its runs."""
    merged: list[Note] = []
    for label in _SHARED_NOTES:
        texts = {
            runs.heading: note.text
            for runs, notes in ((reference, theirs), (subject, ours))
            for note in notes
            if note.label == label
        }
        if len(texts) == 2 and len(set(texts.values())) == 1:
            merged.append(Note(label, next(iter(texts.values()))))
        else:
            merged += [Note(f"{label}, {heading}", text) for heading, text in texts.items()]
    return tuple(merged)


CellName: TypeAlias = tuple[str, str]
"""(task, column label); no label where two methods are compared, since each cell then has both."""


@dataclass(frozen=True)
class Pair:
    """A cell of the subject and the same of the reference; both have scores.

    Attributes:
        subject: judged.
        reference: what it is compared with.
        identical_runs: runs of one identity whose evaluations are equal in both, bit for bit.
        changed_runs: runs of one identity whose evaluations are not.
    """

    subject: Cell
    reference: Cell
    identical_runs: int = 0
    changed_runs: int = 0

    @property
    def identical(self) -> bool:
        """Whether both hold the same runs and nothing else, so that there is nothing to test."""
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
        kind: what is compared.
        subject: judged: the first method, or the second folder.
        reference: the other.
        pairs: the cells of both.
        only_subject: cells that the reference lacks.
        only_reference: cells that the subject lacks.
        crashed: those of `only_reference` where the subject was tried and every seed crashed.
        differences: other fields in which two folders differ; refused ones never get here.
        notes: of their tables' footnotes.
    """

    kind: Literal["methods", "folders"]
    subject: NamedRuns
    reference: NamedRuns
    pairs: Mapping[CellName, Pair]
    only_subject: tuple[CellName, ...]
    only_reference: tuple[CellName, ...]
    notes: tuple[Note, ...]
    crashed: frozenset[CellName] = frozenset()
    differences: tuple[Difference, ...] = ()

    @property
    def unit(self) -> str:
        """The word for a cell: two methods differ on a task, two folders in a cell."""
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
        NamedRuns(
            column.label, column.label, columns[column], [each for each in failures if each.method == column.method]
        )
        for column in (one, two)
    )
    cells, notes = zip(*(cells_of(each, statistic, tasks, rule) for each in (subject, reference)), strict=True)
    by_task: list[Cells] = [{(task, ()): found for (task, _), found in each.items()} for each in cells]
    return _paired("methods", subject, reference, by_task[0], by_task[1], {}, merged_notes(subject, reference, *notes))


def pair_folders(
    reference: NamedRuns,
    subject: NamedRuns,
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
    found = differences(common)
    refuse_other_conditions(common, found, allowed)
    tried = {(failure.task, variant_of(failure)) for failure in subject.failures}
    crashed = frozenset(
        (key[0], labels[each.records[0].identity_hash])
        for key, each in theirs.items()
        if key not in ours and key in tried
    )
    return replace(pairing, differences=tuple(found), crashed=crashed)


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


def _labels(found: Iterable[CellRuns]) -> dict[str, str]:
    """Column label by identity hash, unique among all these cells."""
    columns = arrange_columns([record for each in found for record in each.records])
    return {record.identity_hash: column.label for column, records in columns.items() for record in records}


def _paired(
    kind: Literal["methods", "folders"],
    subject: NamedRuns,
    reference: NamedRuns,
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
            f"{subject.name} and {reference.name} have no cell in common: the former has {_listed(map(name, ours))}, "
            f"the latter {_listed(map(name, theirs))}.",
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


def _pair(ours: CellRuns, theirs: CellRuns) -> Pair:
    known = {record.identity_hash: record for record in theirs.records}
    same = [
        _outcome(record) == _outcome(other) for record in ours.records if (other := known.get(record.identity_hash))
    ]
    return Pair(ours.cell, theirs.cell, identical_runs=sum(same), changed_runs=len(same) - sum(same))


def _outcome(record: Record) -> tuple[object, ...]:
    return record.status, record.diverged_at, record.evaluations, record.further


Verdict: TypeAlias = Outcome | Literal["identical"]

VERDICTS: tuple[Verdict, ...] = ("worse", "undecided", "better", "untested", "identical")
"""In the order of the output: cells that ask for a look come first."""

_UNJUDGED = "They cannot be judged, and do not count for the exit code."


@dataclass(frozen=True)
class Compared:
    """A comparison with its outcome. Identical cells are not in `contrast`: they take no part in the correction."""

    pairing: Pairing
    contrast: Contrast[CellName]
    rule: Rule
    statistic: Statistic

    @property
    def regressed(self) -> bool:
        """Whether the second folder is worse on any cell; of two methods, one may well be."""
        return self.pairing.kind == "folders" and bool(self.contrast.having("worse"))

    def verdict(self, cell: CellName) -> Verdict:
        """The verdict on a cell."""
        return "identical" if self.pairing.pairs[cell].identical else self.contrast.cells[cell].outcome

    def having(self, verdict: Verdict) -> list[CellName]:
        """The cells of one verdict."""
        return [cell for cell in self.pairing.pairs if self.verdict(cell) == verdict]


def compare(pairing: Pairing, rule: Rule, statistic: Statistic) -> Compared:
    """Judge the subject of a pairing by a rule, whose scope plays no part.

    Raises:
        UserError: the test cannot be made with these records, or α is 0 or 1.
    """
    if not 0.0 < rule.alpha < 1.0:
        raise UserError(f"At level {rule.alpha:g} every verdict is settled beforehand.", "Use --alpha 0.05.")
    try:
        outcome = contrast({cell: pair.samples for cell, pair in pairing.pairs.items() if not pair.identical}, rule)
    except ValueError as error:
        raise UserError(f"The test cannot be made: {error}", "Choose another with --test, e.g. welch.") from error
    return Compared(pairing, outcome, rule, statistic)


def warnings_of(compared: Compared) -> list[Warning]:
    """Warnings for a reader of the exit code alone."""
    pairing, warnings = compared.pairing, []
    if pairing.kind == "folders" and pairing.only_reference:
        gone = ", ".join(
            name_of(cell) + (" (every seed crashed)" if cell in pairing.crashed else "")
            for cell in pairing.only_reference
        )
        warnings.append(
            Warning(what=f"{pairing.subject.name} lacks cells of {pairing.reference.name}: {gone}.", remedy=_UNJUDGED)
        )
    if blind := blind_because(compared):
        warnings.append(Warning(what=f"This comparison cannot find anything: {blind}.", remedy="Use more, or --test."))
    return warnings


def summary(compared: Compared) -> str:
    """``dilo against smodice: better on 1 task, worse on 0, undecided on 1``; a regression gate says worse first."""
    pairing = compared.pairing
    first: list[Verdict] = (
        ["better", "worse", "undecided"] if pairing.kind == "methods" else ["worse", "undecided", "better"]
    )
    parts: list[str] = []
    for verdict in [*first, *(other for other in VERDICTS if other not in first and compared.having(other))]:
        count = len(compared.having(verdict))
        number = f"{count}" if parts else counted(count, pairing.unit)
        parts.append(f"{verdict}{'' if verdict == 'identical' else ' on'} {number}")
    return f"{pairing.subject.heading} against {pairing.reference.heading}: {', '.join(parts)}"


def blind_because(compared: Compared) -> str | None:
    """The reason why no scores could have led to a verdict; None where some could, or where all is identical."""
    judged, rule = list(compared.contrast.cells.values()), compared.rule
    if not judged or any(cell.reachable for cell in judged):
        return None
    units = f"{unit(rule.test)}s"
    tested = [cell for cell in judged if cell.p is not None]
    if not tested:
        return f"no cell has two {units} in both"
    largest = max(tested, key=lambda cell: min(_sizes(cell, rule)))
    sizes = " against ".join(map(str, _sizes(largest, rule)))
    times = f", times {len(tested)} under Holm" if rule.correction == "holm" and len(tested) > 1 else ""
    return f"with {sizes} {units}, {TESTS[rule.test]} gives at best p = {best_p(largest, rule.test):.2g}{times}"


def _sizes(cell: Comparison, rule: Rule) -> tuple[int, int]:
    return scores_compared(rule.test, cell.subject), scores_compared(rule.test, cell.reference)
