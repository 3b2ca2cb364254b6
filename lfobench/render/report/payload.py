"""The numbers that the page's script works with, as JSON that can stand inside a ``<script>``."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from lfobench.render.cell_text import LOST
from lfobench.render.footnote import seeds_note
from lfobench.render.highlight_note import CORRECTIONS, SCOPES, unit, without_spread_note
from lfobench.render.highlight_note import TESTS as WORDS
from lfobench.render.markup import Markup
from lfobench.render.plots.compared import demonstration_score
from lfobench.render.plots.style import Look
from lfobench.render.report.curves import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Panel, dashes
from lfobench.render.report.evidence import Evidence
from lfobench.render.report.verdict import REACHABLE
from lfobench.render.table import HIGHLIGHT_NOTE, Cell, Column, Row, Table
from lfobench.stats.comparison import PAIRED, T_TESTS
from lfobench.stats.intervals import t_interval
from lfobench.stats.names import HighlightTest
from lfobench.words import harmless_lines

LEVEL = 0.95
_DIGITS = 2
"""Of the scores that are only drawn or listed; what decides is unrounded."""


def payload(evidence: Evidence, panels: Sequence[Panel], looks: Mapping[Column, Look]) -> dict[str, Any]:
    """Rule, words, columns, rows with their p-values, and the curves."""
    table = evidence.table
    rule = table.rule
    return {
        "rule": {"test": rule.test, "scope": rule.scope, "correction": rule.correction, "alpha": rule.alpha},
        "words": {
            "tests": {test: WORDS[test] for test in evidence.tests},
            "units": {test: unit(test) for test in evidence.tests},
            "withoutSpread": {test: without_spread_note(test, "") for test in evidence.tests if test in T_TESTS},
            "corrections": CORRECTIONS,
            "scopes": SCOPES,
            "reachable": REACHABLE,
        },
        "labels": {"highlight": HIGHLIGHT_NOTE, "lost": LOST},
        "paired": sorted(PAIRED),
        "seeds": {test: _seeds_note(table, test) for test in evidence.tests},
        "unavailable": {f"{test} {scope}": reason for (test, scope), reason in evidence.unavailable.items()},
        "pairs": [list(pair) for pair in evidence.pairs],
        "columns": [_column(column, looks[column]) for column in evidence.columns],
        "positions": [index for index, column in enumerate(table.columns) if column.run_here],
        "rows": [_row(evidence, index, panel) for index, panel in enumerate(panels)],
        "level": LEVEL,
        "frame": {"width": WIDTH, "height": HEIGHT, "left": LEFT, "right": RIGHT, "top": TOP, "bottom": BOTTOM},
    }


def as_json(value: Any) -> Markup:
    """`value` as JSON without a character that could end the script, begin a comment or break a line of code."""
    text = json.dumps(_harmless(value), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(re.sub("[<>&\u2028\u2029]", lambda found: f"\\u{ord(found[0]):04x}", text))


def _harmless(value: Any) -> Any:
    if isinstance(value, str):
        return harmless_lines(value)
    if isinstance(value, Mapping):
        return {_harmless(key): _harmless(each) for key, each in value.items()}
    return [_harmless(each) for each in value] if isinstance(value, list | tuple) else value


def _column(column: Column, look: Look) -> dict[str, Any]:
    return {"label": column.label, "kind": column.kind, "colour": look.colour, "dashes": dashes(look)}


def _best_cases(evidence: Evidence, row: Row) -> dict[str, dict[str, list[Any] | None]]:
    """By test and scope: smallest p-value, as printed, and number of scores."""
    found = {(test, scope): evidence.best_case(row, test, scope) for test in evidence.tests for scope in SCOPES}
    return {
        test: {
            scope: None if (case := found[test, scope]) is None else [case[0], f"{case[0]:.2g}", case[1]]
            for scope in SCOPES
        }
        for test in evidence.tests
    }


def _seeds_note(table: Table, test: HighlightTest) -> str:
    """The footnote's word on seeds says what they allow, which a paired test changes."""
    return seeds_note(replace(table, rule=replace(table.rule, test=test))).text


def _row(evidence: Evidence, index: int, panel: Panel) -> dict[str, Any]:
    table, row, axes = evidence.table, evidence.rows[index], panel.axes
    cells = [cell for column, cell in zip(table.columns, row.cells, strict=True) if column.run_here]
    return {
        "task": row.task,
        "p": {test: list(of_rows[index]) for test, of_rows in evidence.p.items()},
        "places": {test: evidence.places(row, test) for test in ("welch", "fisher") if test in evidence.tests},
        "withoutSpread": {test: evidence.without_spread(row, test) for test in sorted(T_TESTS)},
        "bestCases": _best_cases(evidence, row),
        "cells": [
            _cell(cell, panel, column) if cell else None for column, cell in zip(evidence.columns, cells, strict=True)
        ],
        "steps": panel.steps,
        "demonstration": demonstration_score(table, row),
        "axes": {
            "steps": axes.steps,
            "scores": axes.scores,
            "stepTicks": axes.step_ticks,
            "scoreTicks": axes.score_ticks,
        },
    }


def _cell(cell: Cell, panel: Panel, column: Column) -> dict[str, Any]:
    sample, curve = cell.sample, panel.curves.get(column)
    interval = t_interval(sample.summary, LEVEL) if sample else None
    return {
        "mean": sample.summary.mean if sample else None,
        "std": sample.summary.std if sample else None,
        "successes": cell.successes.pooled.successes if cell.successes else None,
        "interval": [_rounded(interval.low), _rounded(interval.high)] if interval else None,
        "scores": [_rounded(score) for score in sample.seeds] if sample else [],
        "seeds": cell.seeds,
        "diverged": cell.diverged_seeds,
        "failed": cell.failed_seeds,
        "curve": curve
        and {
            "steps": None if curve.steps == panel.steps else curve.steps,
            "seeds": [[_rounded(score) for score in seed] for seed in curve.seeds],
            "means": [_rounded(mean) for mean in curve.means],
            "diverged": curve.diverged,
        },
    }


def _rounded(score: float | None) -> float | None:
    # Adding 0 turns -0.0, which JSON would print, into 0.0.
    return None if score is None else round(score, _DIGITS) + 0.0
