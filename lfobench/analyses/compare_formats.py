"""A comparison as text: counts first, then every cell under its verdict, then what it rests on; and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from lfobench.analyses.compare import (
    VERDICTS,
    CellName,
    Compared,
    Pairing,
    Verdict,
    blind_because,
    name_of,
    summary,
)
from lfobench.analyses.conditions import Difference, shortened
from lfobench.stats.contrast import Aggregate
from lfobench.stats.intervals import Estimate, Interval
from lfobench.stats.tests import PAIRED
from lfobench.tables.document import Document, Grid, Notes, Paragraphs, Section
from lfobench.tables.exporters.json import interval_value, json_text, notes_value
from lfobench.tables.footnote import CORRECTIONS, TESTS, unit, without_spread_note
from lfobench.tables.table import DIVERGED, FAILED, MISSING, Cell, Note, cell_text
from lfobench.text import counted, short_number

_STYLES: dict[Verdict, str] = {"worse": "bold red", "better": "bold green"}
_REASONS: dict[Verdict, str] = {
    "untested": ": fewer than two {unit}s in one of the two",
    "identical": ": the same runs, bit for bit, so there is nothing to test",
}


def document(compared: Compared) -> Document:
    """The comparison for a terminal."""
    pairing, rule = compared.pairing, compared.rule
    names: tuple[str, ...] = ()
    if pairing.kind == "folders":
        names = tuple(f"{each.heading}  {each.name}" for each in (pairing.reference, pairing.subject))
    sections = [
        Section(
            f"{verdict} ({len(cells)}){_REASONS.get(verdict, '').format(unit=unit(rule.test))}",
            _STYLES.get(verdict, "bold"),
            [_row(compared, cell) for cell in cells],
        )
        for verdict in VERDICTS
        if (cells := compared.having(verdict))
    ]
    headings = _as_named(pairing, pairing.subject.heading, pairing.reference.heading)
    interval = f"difference [{100.0 * (1.0 - rule.alpha):.4g}% interval]"
    corrected = [] if rule.correction == "none" else [f"p, {CORRECTIONS[rule.correction]}"]
    return Document(
        (
            *([Paragraphs(names)] if names else []),
            Paragraphs((summary(compared),), "bold"),
            Grid(["n", *headings, interval, "p", *corrected], sections),
            Notes(list(notes(compared))),
        )
    )


def _as_named(pairing: Pairing, subject: str, reference: str) -> tuple[str, str]:
    """A text of each, in the order in which the user named them."""
    return (subject, reference) if pairing.kind == "methods" else (reference, subject)


def _row(compared: Compared, name: CellName) -> list[str]:
    pair, judged = compared.pairing.pairs[name], compared.contrast.cells.get(name)
    sizes = _as_named(compared.pairing, str(len(pair.subject.seeds)), str(len(pair.reference.seeds)))
    corrected = [] if compared.rule.correction == "none" else [_p(judged.adjusted_p if judged else None)]
    return [
        name_of(name),
        sizes[0] if sizes[0] == sizes[1] else ", ".join(sizes),
        *_as_named(compared.pairing, str(cell_text(pair.subject)), str(cell_text(pair.reference))),
        f"{short_number(judged.difference, '+z.1f')}{_ends(judged.interval, '+z.1f')}" if judged else "0",
        _p(judged.p if judged else None),
        *corrected,
    ]


def _p(value: float | None) -> str:
    return MISSING if value is None else "<0.0001" if value < 1e-4 else f"{value:.2g}"


def _ends(interval: Interval | None, form: str) -> str:
    return f" [{short_number(interval.low, form)}, {short_number(interval.high, form)}]" if interval else ""


def notes(compared: Compared) -> Iterator[Note]:
    """Everything that a reader must know to judge the verdicts."""
    pairing, rule = compared.pairing, compared.rule
    if compared.contrast.aggregate is not None:
        yield Note("Together", _aggregated(compared.contrast.aggregate, pairing))
    yield Note(
        "Verdicts",
        f"{pairing.subject.heading} against {pairing.reference.heading} by {TESTS[rule.test]}: better or worse where "
        f"p < {rule.alpha:g}{_corrected(compared)}. Intervals of a difference are "
        f"{'Newcombe' if rule.test == 'fisher' else 'Welch'}'s, of each {pairing.unit} alone.",
    )
    if rule.test in PAIRED:
        yield Note(
            "Pairs", "the test generalises to other starts of these trained policies, not to other training seeds."
        )
    if without := [name_of(cell) for cell, each in compared.contrast.cells.items() if each.without_spread]:
        yield Note("No spread", without_spread_note(rule.test, ", ".join(without)))
    if blind := blind_because(compared):
        yield Note("Design", f"this comparison cannot find anything: {blind}. Use more, or another test.")
    yield from _folder_notes(pairing)
    yield from pairing.notes
    cells = [cell for pair in pairing.pairs.values() for cell in (pair.subject, pair.reference)]
    if any(cell.diverged_seeds or cell.failed_seeds for cell in cells):
        yield Note("Marks", f"{DIVERGED}k: k diverged seeds, score 0. {FAILED}k: k crashed seeds, not in n.")


def _corrected(compared: Compared) -> str:
    tested, rule, unit = len(compared.contrast.tested), compared.rule, compared.pairing.unit
    if tested < 2:
        return ""
    if rule.correction == "none":
        return (
            f", not corrected: of {tested} {unit}s without a difference, {tested * rule.alpha:.2g} are expected to "
            "come out better or worse"
        )
    return (
        f", corrected by {CORRECTIONS[rule.correction]} over the {tested} {unit}s tested; uncorrected, each of them is "
        "one more chance of a false alarm"
    )


def _aggregated(aggregate: Aggregate[CellName], pairing: Pairing) -> str:
    better, middle = aggregate.improvement, aggregate.interquartile_mean
    return (
        f"over {counted(len(aggregate.cells), pairing.unit)} with two seeds or more in both, a run of "
        f"{pairing.subject.heading} beats one of {pairing.reference.heading} with probability "
        f"{better.value:.2f}{_ends(better.interval, '.2f')}; the interquartile mean differs by "
        f"{short_number(middle.value, '+z.1f')}{_ends(middle.interval, '+z.1f')}. Intervals "
        "by stratified bootstrap, too narrow for few seeds."
    )


def _folder_notes(pairing: Pairing) -> Iterator[Note]:
    for label, cells in (
        (f"Only in {pairing.reference.heading}", pairing.only_reference),
        (f"Only in {pairing.subject.heading}", pairing.only_subject),
    ):
        if cells:
            yield Note(label, f"{', '.join(map(name_of, cells))}.")
    partly = [
        f"{pair.identical_runs} of {len(pair.subject.seeds)} ({name_of(cell)})"
        for cell, pair in pairing.pairs.items()
        if pair.identical_runs and not pair.identical
    ]
    if partly:
        yield Note("Identical runs", f"{', '.join(partly)}: the two samples are not independent.")
    changed = [name_of(cell) for cell, pair in pairing.pairs.items() if pair.changed_runs]
    if changed:
        yield Note(
            "Changed runs",
            f"one identity, other numbers: {', '.join(changed)}. Either another machine or library rounds otherwise, "
            "or a change of the software has not raised its version.",
        )
    for label, kind in (("Conditions", "condition"), ("Software", "software"), ("Machines", "machine")):
        if texts := [_differs(each, len(pairing.pairs)) for each in pairing.differences if each.kind == kind]:
            yield Note(f"{label} differ", f"{'; '.join(texts)}.")


def _differs(difference: Difference, cells: int) -> str:
    where = "every cell" if len(difference.cells) == cells else ", ".join(difference.cells)
    values = f"{difference.field}: {shortened(difference.reference)} → {shortened(difference.subject)}"
    return f"{values} ({where})" if where else values


def json_comparison(compared: Compared) -> str:
    """One object: both sets of runs, the counts, every cell with its scores, the aggregates, the differences."""
    pairing, rule = compared.pairing, compared.rule
    aggregate = compared.contrast.aggregate
    return json_text(
        {
            "kind": pairing.kind,
            "subject": pairing.subject.name,
            "reference": pairing.reference.name,
            "summary": summary(compared),
            "regressed": compared.regressed,
            "statistic": str(compared.statistic),
            "rule": {"test": rule.test, "correction": rule.correction, "alpha": rule.alpha},
            "counts": {verdict: len(compared.having(verdict)) for verdict in VERDICTS},
            "cannot_find_anything": blind_because(compared),
            "cells": [_pair_value(compared, cell) for cell in pairing.pairs],
            "aggregate": aggregate
            and {
                "cells": [_name_value(cell) for cell in aggregate.cells],
                "probability_of_improvement": _estimate_value(aggregate.improvement),
                "difference_of_interquartile_means": _estimate_value(aggregate.interquartile_mean),
            },
            "only_in_subject": [_name_value(cell) for cell in pairing.only_subject],
            "only_in_reference": [
                {**_name_value(cell), "every_seed_crashed": cell in pairing.crashed} for cell in pairing.only_reference
            ],
            "differences": [asdict(each) for each in pairing.differences],
            "notes": notes_value(list(notes(compared))),
        }
    )


def _name_value(cell: CellName) -> dict[str, str]:
    task, label = cell
    return {"task": task, "column": label} if label else {"task": task}


def _pair_value(compared: Compared, name: CellName) -> dict[str, Any]:
    pair, judged = compared.pairing.pairs[name], compared.contrast.cells.get(name)
    return {
        **_name_value(name),
        "verdict": compared.verdict(name),
        "difference": judged.difference if judged else 0.0,
        "interval": interval_value(judged.interval if judged else None),
        "p": judged and judged.p,
        "adjusted_p": judged and judged.adjusted_p,
        "verdict_reachable": judged and judged.reachable,
        "without_spread": judged and judged.without_spread,
        "subject": _cell_value(pair.subject),
        "reference": _cell_value(pair.reference),
        "identical_runs": pair.identical_runs,
        "changed_runs": pair.changed_runs,
    }


def _cell_value(cell: Cell) -> dict[str, Any]:
    assert cell.sample is not None
    summary = cell.sample.summary
    return {
        "n": summary.n,
        "mean": summary.mean,
        "std": summary.std,
        "seeds": cell.seeds,
        "scores": cell.sample.seeds,
        **(asdict(cell.successes.pooled) if cell.successes else {}),
        "diverged_seeds": cell.diverged_seeds,
        "failed_seeds": cell.failed_seeds,
    }


def _estimate_value(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "interval": interval_value(estimate.interval)}
