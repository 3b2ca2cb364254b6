"""A comparison on a terminal: counts first, then every cell under its verdict, then what it rests on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, Literal

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.text import Text

from lfobench.analyses.compare import (
    VERDICTS,
    CellName,
    Compared,
    Difference,
    Pairing,
    Verdict,
    blind_because,
    name_of,
    shortened,
    summary,
)
from lfobench.stats.contrast import Aggregate
from lfobench.stats.intervals import Estimate, Interval
from lfobench.stats.tests import PAIRED
from lfobench.tables.exporters.terminal import Section, aligned, wrapped
from lfobench.tables.footnote import CORRECTIONS, TESTS, unit, without_spread_note
from lfobench.tables.table import DIVERGED, FAILED, Cell, Note, cell_text
from lfobench.text import short_number

_STYLES: dict[Verdict, str] = {"worse": "bold red", "better": "bold green"}
_REASONS: dict[Verdict, str] = {
    "untested": ", for want of a second {unit} on both sides",
    "identical": ": the same runs, bit for bit, so there is nothing to test",
}


def terminal(compared: Compared) -> RenderableType:
    """What ``Console.print`` draws a comparison from."""
    return _Terminal(compared)


class _Terminal:
    def __init__(self, compared: Compared) -> None:
        self.compared = compared

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        compared = self.compared
        pairing = compared.pairing
        if pairing.kind == "folders":
            for side in (pairing.reference, pairing.subject):
                yield Text(f"{side.heading}  {side.name}")
        yield Text(summary(compared), "bold")
        yield Text()
        yield from aligned(_columns(compared), list(_sections(compared)), options.max_width)
        yield Text()
        yield from wrapped(list(contrast_notes(compared)), options.max_width)


def _sides(compared: Compared) -> tuple[Literal["subject", "reference"], ...]:
    """In the order in which the user named them."""
    return ("subject", "reference") if compared.pairing.kind == "methods" else ("reference", "subject")


def _columns(compared: Compared) -> list[str]:
    rule = compared.rule
    headings = [getattr(compared.pairing, side).heading for side in _sides(compared)]
    corrected = [] if rule.correction == "none" else [f"p, {CORRECTIONS[rule.correction]}"]
    return ["n", *headings, f"difference [{100.0 * (1.0 - rule.alpha):.4g}% interval]", "p", *corrected]


def _sections(compared: Compared) -> Iterator[Section]:
    for verdict in VERDICTS:
        if cells := compared.having(verdict):
            reason = _REASONS.get(verdict, "").format(unit=unit(compared.rule.test))
            yield Section(
                f"{verdict} ({len(cells)}){reason}",
                _STYLES.get(verdict, "bold"),
                [_row(compared, cell) for cell in cells],
            )


def _row(compared: Compared, name: CellName) -> list[str]:
    pair, judged = compared.pairing.pairs[name], compared.contrast.cells.get(name)
    cells: list[Cell] = [getattr(pair, side) for side in _sides(compared)]
    sizes = [str(len(cell.seeds)) for cell in cells]
    corrected = [] if compared.rule.correction == "none" else [_p(judged.adjusted_p if judged else None)]
    return [
        name_of(name),
        sizes[0] if sizes[0] == sizes[1] else ", ".join(sizes),
        *(str(cell_text(cell)) for cell in cells),
        f"{short_number(judged.difference, '+z.1f')}{_ends(judged.interval, '+z.1f')}" if judged else "0",
        _p(judged.p if judged else None),
        *corrected,
    ]


def _p(value: float | None) -> str:
    return "–" if value is None else "<0.0001" if value < 1e-4 else f"{value:.2g}"


def contrast_notes(compared: Compared) -> Iterator[Note]:
    """Everything that a reader must know to judge the verdicts."""
    pairing, rule, tested = compared.pairing, compared.rule, len(compared.contrast.tested)
    subject, reference = pairing.subject.heading, pairing.reference.heading
    if compared.contrast.aggregate is not None:
        yield Note("Together", _aggregated(compared.contrast.aggregate, pairing))
    corrected = ""
    if tested > 1 and rule.correction == "none":
        corrected = (
            f", not corrected: of {tested} {pairing.unit}s without a difference, {tested * rule.alpha:.2g} are "
            "expected to come out better or worse"
        )
    elif tested > 1:
        corrected = (
            f", corrected by {CORRECTIONS[rule.correction]} over the {tested} {pairing.unit}s tested; uncorrected, "
            "each of them is one more chance of a false alarm"
        )
    yield Note(
        "Verdicts",
        f"{subject} against {reference} by {TESTS[rule.test]}: better or worse where p < {rule.alpha:g}{corrected}. "
        f"Intervals of a difference are {'Newcombe' if rule.test == 'fisher' else 'Welch'}'s, of each {pairing.unit} "
        "alone.",
    )
    if rule.test in PAIRED:
        yield Note("Pairs", "the test speaks of other starts of these trained policies, not of other training seeds.")
    if without := [name_of(cell) for cell, each in compared.contrast.cells.items() if each.without_spread]:
        yield Note("No spread", without_spread_note(rule.test, ", ".join(without)))
    if blind := blind_because(compared):
        yield Note("Design", f"this comparison cannot find anything: {blind}. Use more, or another test.")
    yield from _folder_notes(compared)
    yield from pairing.notes
    cells = [cell for pair in pairing.pairs.values() for cell in (pair.subject, pair.reference)]
    if any(cell.diverged_seeds or cell.failed_seeds for cell in cells):
        yield Note("Marks", f"{DIVERGED}k: k diverged seeds, score 0. {FAILED}k: k crashed seeds, not in n.")


def _aggregated(aggregate: Aggregate[CellName], pairing: Pairing) -> str:
    better, middle = aggregate.improvement, aggregate.interquartile_mean
    count = len(aggregate.cells)
    return (
        f"over {count} {pairing.unit}{'' if count == 1 else 's'} with two seeds or more on both sides, a run of "
        f"{pairing.subject.heading} beats one of {pairing.reference.heading} with probability "
        f"{better.value:.2f}{_ends(better.interval, '.2f')}; the interquartile mean differs by "
        f"{short_number(middle.value, '+z.1f')}{_ends(middle.interval, '+z.1f')}. Intervals "
        "by stratified bootstrap, too narrow for few seeds."
    )


def _ends(interval: Interval | None, form: str) -> str:
    return f" [{short_number(interval.low, form)}, {short_number(interval.high, form)}]" if interval else ""


def _folder_notes(compared: Compared) -> Iterator[Note]:
    pairing = compared.pairing
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


def json_contrast(compared: Compared) -> str:
    """One object: the sides, the counts, every cell with the scores behind it, the aggregates, what differs."""
    pairing, rule = compared.pairing, compared.rule
    aggregate = compared.contrast.aggregate
    value = {
        "kind": pairing.kind,
        "subject": pairing.subject.name,
        "reference": pairing.reference.name,
        "summary": summary(compared),
        "regressed": compared.regressed,
        "statistic": str(compared.statistic),
        "rule": {"test": rule.test, "correction": rule.correction, "alpha": rule.alpha},
        "counts": {verdict: len(compared.having(verdict)) for verdict in VERDICTS},
        "cannot_find_anything": blind_because(compared),
        "cells": [_cell_object(compared, cell) for cell in pairing.pairs],
        "aggregate": aggregate
        and {
            "cells": [_named(cell) for cell in aggregate.cells],
            "probability_of_improvement": _estimate_object(aggregate.improvement),
            "difference_of_interquartile_means": _estimate_object(aggregate.interquartile_mean),
        },
        "only_in_subject": [_named(cell) for cell in pairing.only_subject],
        "only_in_reference": [
            {**_named(cell), "every_seed_crashed": cell in pairing.crashed} for cell in pairing.only_reference
        ],
        "differences": [
            {
                "field": each.field,
                "kind": each.kind,
                "reference": each.reference,
                "subject": each.subject,
                "cells": list(each.cells),
            }
            for each in pairing.differences
        ],
        "notes": [{"label": note.label, "text": note.text} for note in contrast_notes(compared)],
    }
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def _cell_object(compared: Compared, name: CellName) -> dict[str, Any]:
    pair, judged = compared.pairing.pairs[name], compared.contrast.cells.get(name)
    return {
        **_named(name),
        "verdict": compared.verdict(name),
        "difference": judged.difference if judged else 0.0,
        "interval": _interval_object(judged.interval) if judged else None,
        "p": judged.p if judged else None,
        "adjusted_p": judged.adjusted_p if judged else None,
        "verdict_reachable": judged.reachable if judged else None,
        "without_spread": judged.without_spread if judged else None,
        "subject": _side_object(pair.subject),
        "reference": _side_object(pair.reference),
        "identical_runs": pair.identical_runs,
        "changed_runs": pair.changed_runs,
    }


def _named(cell: CellName) -> dict[str, str]:
    task, label = cell
    return {"task": task, "column": label} if label else {"task": task}


def _side_object(cell: Cell) -> dict[str, Any]:
    assert cell.sample is not None
    counted = cell.successes.pooled if cell.successes else None
    return {
        "n": cell.sample.summary.n,
        "mean": cell.sample.summary.mean,
        "std": cell.sample.summary.std,
        "seeds": list(cell.seeds),
        "scores": list(cell.sample.seeds),
        **({"successes": counted.successes, "trials": counted.trials} if counted else {}),
        "diverged_seeds": list(cell.diverged_seeds),
        "failed_seeds": list(cell.failed_seeds),
    }


def _estimate_object(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "interval": _interval_object(estimate.interval)}


def _interval_object(interval: Interval | None) -> dict[str, float] | None:
    return {"low": interval.low, "high": interval.high, "level": interval.level} if interval else None
