"""The report: one HTML file that needs no server, no network and, to be read, no script."""

from __future__ import annotations

import hashlib
import json
import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import cache
from importlib.resources import files
from typing import Any

from lfobench.html_report.curves import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    Panel,
    column_looks,
    curves_section,
    dashes,
    panels,
)
from lfobench.html_report.knobs import Knobs, alphas_of, columns_of, in_scope, knobs_of, pair_counts, tests_of
from lfobench.html_report.runs import cells, reproduce_section, runs_section
from lfobench.html_report.verdict import REACHABLE, how, pairs_how, problems_section, sentence, verdict
from lfobench.html_report.verdict import tasks as counted_tasks
from lfobench.plots.captions import demonstration_score
from lfobench.plots.figure import Look
from lfobench.record import Failure, Record, Warning
from lfobench.score import Statistic
from lfobench.stats.highlight import DEFAULT_RULE, Rule
from lfobench.stats.intervals import t_interval
from lfobench.tables.building import build_table
from lfobench.tables.exporters.html import Markup, element, notes_list, score_table, table_style
from lfobench.tables.footnote import CORRECTIONS, SCOPES, TESTS, highlight_notes, seeds_note, unit
from lfobench.tables.table import HIGHLIGHT_NOTE, LOST, Cell, Column, Row, Table
from lfobench.text import harmless_lines

LEVEL = 0.95
_DIGITS = 2
"""Of the scores that are only drawn or listed; what decides is unrounded."""


def payload(knobs: Knobs, panels: Sequence[Panel], looks: Mapping[Column, Look]) -> dict[str, Any]:
    """Columns, rows with their curves, and what each setting of the knobs shows."""
    table = knobs.table
    texts: dict[str, int] = {}
    views = {_key(rule): _view(decided, texts) for rule, decided in knobs.tables.items()}
    return {
        "labels": {"highlight": HIGHLIGHT_NOTE, "lost": LOST},
        "unavailable": {f"{test} {scope}": reason for (test, scope), reason in knobs.obstacles.items()},
        "columns": [_column(column, looks[column]) for column in columns_of(table)],
        "positions": [index for index, column in enumerate(table.columns) if column.run_here],
        "rows": [_row(table, row, panel) for (_, row), panel in zip(table.rows(), panels, strict=True)],
        "level": LEVEL,
        "frame": {"width": WIDTH, "height": HEIGHT, "left": LEFT, "right": RIGHT, "top": TOP, "bottom": BOTTOM},
        "views": views,
        "texts": list(texts),
    }


def _key(rule: Rule) -> str:
    """A setting of the knobs as the page's script spells it."""
    return f"{rule.test} {rule.scope} {rule.correction} {rule.alpha!r}"


def _view(table: Table, texts: dict[str, int]) -> dict[str, Any]:
    """Everything that depends on the knobs, under one setting; texts by their place in `texts`, which grows."""

    def place(text: str) -> int:
        return texts.setdefault(text, len(texts))

    notes = list(highlight_notes(table))
    design = next((note.text for note in notes if note.label == "Design"), REACHABLE)
    competing = in_scope(table)
    cells = [
        [cell for column, cell in zip(table.columns, row.cells, strict=True) if column.run_here]
        for _, row in table.rows()
    ]
    return {
        "verdict": place(sentence(table)),
        "how": place(how(table)),
        "design": place(design),
        "pairsHow": place(pairs_how(table.rule)),
        "seeds": place(seeds_note(table).text),
        "notes": [[note.label, place(note.text)] for note in notes],
        "highlighted": [[index for index, cell in enumerate(row) if cell and cell.highlighted] for row in cells],
        "lost": [[index for index, cell in enumerate(row) if cell and cell.lost] for row in cells],
        "pairs": [
            [each.better, each.worse, each.undecided, each.untested] if {each.first, each.second} <= competing else None
            for each in pair_counts(table)
        ],
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


def _row(table: Table, row: Row, panel: Panel) -> dict[str, Any]:
    axes, columns = panel.axes, columns_of(table)
    cells = [cell for column, cell in zip(table.columns, row.cells, strict=True) if column.run_here]
    return {
        "task": row.task,
        "cells": [_cell(cell, panel, column) if cell else None for column, cell in zip(columns, cells, strict=True)],
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


TITLE = "Offline imitation from observation: a comparison"


def report(
    records: Sequence[Record],
    failures: Sequence[Failure] = (),
    warnings: Sequence[Warning] = (),
    statistic: Statistic | None = None,
    rule: Rule = DEFAULT_RULE,
    tasks: Sequence[str] = (),
    methods: Sequence[str] = (),
    title: str = TITLE,
    now: datetime | None = None,
    filters: Sequence[str] = (),
) -> str:
    """The page for `records`: a function of its arguments, byte for byte.

    Args:
        records: from one source under one protocol, in any order.
        failures: runs that crashed.
        warnings: of the folder that the records come from.
        statistic: what a run's evaluations are reduced to; by default as in `build_table`.
        rule: the knobs that the page opens with; all others can be set in it.
        tasks: names in row order.
        methods: names in column order, and in the order in which colours are handed out.
        title: heading of the page.
        now: when the page was made; left out of it where None.
        filters: options of ``lfobench table`` that select these records, for the commands of the page.

    Raises:
        UserError: as `build_table`.
    """
    table = build_table(records, statistic, rule, tasks, methods, failures)
    records = [record for _, members in cells(table, records) for record in members]
    knobs = knobs_of(table)
    drawn, looks = panels(table, records), column_looks(table, methods)
    body = [
        _header(table, records, title, now),
        element(
            "main",
            verdict(table),
            _table_section(table),
            curves_section(table, records, drawn, looks),
            runs_section(table, records),
            problems_section(records, failures, warnings),
            reproduce_section(records, failures, table.statistic, rule, filters),
        ),
        element("script", as_json(payload(knobs, drawn, looks)), type="application/json", id="evidence"),
        element("script", Markup(script())),
    ]
    return f"<!DOCTYPE html>\n{element('html', _head(title), element('body', *body), lang='en')}\n"


@cache
def style() -> str:
    """The style sheet of the page."""
    return table_style() + _file("report.css")


@cache
def script() -> str:
    """The page's script."""
    return f'"use strict";\n{{\n{_file("details.js")}\n{_file("report.js")}}}\n'


def _file(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _head(title: str) -> Markup:
    # Only this style and this script run, and nothing can be loaded, whatever a record holds.
    policy = (
        f"default-src 'none'; style-src '{_digest(style())}'; script-src '{_digest(script())}'; "
        "base-uri 'none'; form-action 'none'"
    )
    return element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", title),
        element("style", Markup(style())),
    )


def _digest(text: str) -> str:
    return f"sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _header(table: Table, records: Sequence[Record], title: str, now: datetime | None) -> Markup:
    run_here = sum(column.run_here for column in table.columns)
    rows = sum(1 for _ in table.rows())
    facts = [
        f"{counted_tasks(rows)} × {run_here} {'method' if run_here == 1 else 'methods'}",
        f"{len(records)} runs",
        f"source {table.source}",
        f"protocol {table.protocol}",
        *([f"made {now:%Y-%m-%d %H:%M %Z}".rstrip()] if now else []),
    ]
    sections = (
        ("verdict-section", "Verdict"),
        ("table", "Table"),
        ("curves", "Learning curves"),
        ("runs", "Runs"),
        ("problems", "Failures and warnings"),
        ("reproduce", "Reproduce"),
    )
    return element(
        "header",
        element("h1", title),
        element("p", " · ".join(facts), class_="facts"),
        element("nav", *(element("a", name, href=f"#{anchor}") for anchor, name in sections), aria_label="Sections"),
    )


def _table_section(table: Table) -> Markup:
    about_highlights = set(highlight_notes(table))
    kinds = tuple("highlight" if note in about_highlights else "" for note in table.notes)
    return element(
        "section",
        element("h2", "Table"),
        _knobs(table),
        element(
            "figure",
            element("div", score_table(table, class_="sortable", id="scores"), class_="scroll", id="scores-scroll"),
            element(
                "p",
                "Point at a cell, tap it, or move through the cells with the arrow keys for its learning curves.",
                class_="caption hint",
                hidden=True,
            ),
            element("figcaption", notes_list(table.notes, kinds), id="notes"),
            class_="lfobench-table",
        ),
        element("div", role="status", class_="spoken-status", id="status"),
        element("aside", id="details", aria_label="Learning curves of a cell", aria_live="polite", hidden=True),
        id="table",
    )


def _knobs(table: Table) -> Markup:
    """Hidden until the script has them at work."""
    rule = table.rule
    units: dict[str, str] = {
        "seed": "over seeds",
        "start state": "over common start states",
        "episode": "over episodes",
    }
    groups = [
        element(
            "optgroup",
            *(
                element(
                    "option",
                    _short(TESTS[test]),
                    value=test,
                    selected=test == rule.test,
                )
                for test in tests
            ),
            label=label,
        )
        for counted, label in units.items()
        if (tests := [test for test in tests_of(table) if unit(test) == counted])
    ]
    scopes = [element("option", SCOPES[scope], value=scope, selected=scope == rule.scope) for scope in SCOPES]
    corrections = [
        element("option", CORRECTIONS[each], value=each, selected=each == rule.correction) for each in CORRECTIONS
    ]
    alphas = [
        element("option", f"{alpha:g}", value=repr(alpha), selected=alpha == rule.alpha) for alpha in alphas_of(table)
    ]
    return element(
        "form",
        element("label", "Test ", element("select", *groups, id="test", name="test")),
        element("label", "Scope ", element("select", *scopes, id="scope", name="scope")),
        element("label", "Correction ", element("select", *corrections, id="correction", name="correction")),
        element("label", "α ", element("select", *alphas, id="alpha", name="alpha")),
        element("button", "Reset", type="reset"),
        id="knobs",
        class_="knobs",
        hidden=True,
        aria_label="How the highlights are decided",
        autocomplete="off",
    )


def _short(test: str) -> str:
    """``the two-sided Mann-Whitney test`` to ``Mann-Whitney test``: a choice needs no article."""
    words = test.replace("two-sided ", "").removeprefix("the ")
    return words[0].upper() + words[1:]
