"""The report: one HTML file that needs no server, no network and, to be read, no script."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from collections.abc import Sequence
from datetime import datetime
from functools import cache
from importlib.resources import files

from lfobench.contract.failure import Failure
from lfobench.contract.record import Record, Warning
from lfobench.contract.statistic import Statistic
from lfobench.render.building import build_table
from lfobench.render.highlight_note import CORRECTIONS, SCOPES, TESTS, highlight_notes, unit
from lfobench.render.html_table import notes_list, score_table, table_style
from lfobench.render.markup import Markup, element
from lfobench.render.report.curves import column_looks, curves_section, panels
from lfobench.render.report.evidence import Evidence, gather
from lfobench.render.report.payload import as_json, payload
from lfobench.render.report.problems import problems_section
from lfobench.render.report.reproduce import reproduce_section
from lfobench.render.report.runs import cells, runs_section
from lfobench.render.report.verdict import tasks as counted_tasks
from lfobench.render.report.verdict import verdict
from lfobench.render.table import Table
from lfobench.stats.highlight import DEFAULT_RULE, Rule

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
    evidence = gather(table)
    drawn, looks = panels(table, records), column_looks(table, methods)
    body = [
        _header(table, records, title, now),
        element(
            "main",
            verdict(evidence),
            _table_section(evidence),
            curves_section(table, records, drawn, looks),
            runs_section(table, records),
            problems_section(records, failures, warnings),
            reproduce_section(records, failures, table.statistic, rule, filters),
        ),
        element("script", as_json(payload(evidence, drawn, looks)), type="application/json", id="evidence"),
        element("script", Markup(script())),
    ]
    return f"<!DOCTYPE html>\n{element('html', _head(title), element('body', *body), lang='en')}\n"


@cache
def style() -> str:
    """The style sheet of the page."""
    return table_style() + _file("report.css")


@cache
def script() -> str:
    """The page's script: the rule, then what draws with it."""
    return f'"use strict";\n{{\n{_file("rule.js")}\n{_file("details.js")}\n{_file("report.js")}}}\n'


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


def _table_section(evidence: Evidence) -> Markup:
    table = evidence.table
    about_highlights = set(highlight_notes(table))
    kinds = tuple("highlight" if note in about_highlights else "" for note in table.notes)
    return element(
        "section",
        element("h2", "Table"),
        _knobs(evidence),
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


def _knobs(evidence: Evidence) -> Markup:
    """Hidden until the script has them at work."""
    rule = evidence.table.rule
    units: dict[str, str] = {
        "seed": "over seeds",
        "start state": "over common start states",
        "episode": "over episodes",
    }
    tests = [
        element(
            "optgroup",
            *(
                element(
                    "option",
                    _short(TESTS[test]),
                    value=test,
                    selected=test == rule.test,
                )
                for test in tests_of
            ),
            label=label,
        )
        for counted, label in units.items()
        if (tests_of := [test for test in evidence.tests if unit(test) == counted])
    ]
    scopes = [element("option", SCOPES[scope], value=scope, selected=scope == rule.scope) for scope in SCOPES]
    corrections = [
        element("option", CORRECTIONS[each], value=each, selected=each == rule.correction) for each in CORRECTIONS
    ]
    alpha = element(
        "input", id="alpha", name="alpha", type="number", min="0", max="1", step="any", value=repr(rule.alpha)
    )
    return element(
        "form",
        element("label", "Test ", element("select", *tests, id="test", name="test")),
        element("label", "Scope ", element("select", *scopes, id="scope", name="scope")),
        element("label", "Correction ", element("select", *corrections, id="correction", name="correction")),
        element("label", "α ", alpha),
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
