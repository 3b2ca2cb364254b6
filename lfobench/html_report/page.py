"""The report: one HTML file that needs no server, no network and, to be read, no script."""

from __future__ import annotations

import hashlib
import json
import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from jinja2 import PackageLoader
from markupsafe import Markup

from lfobench.html_report.curves import curves_caption, dashes, panels
from lfobench.html_report.knobs import Knobs, choices, in_scope, knobs_of, pair_counts
from lfobench.html_report.reproduction import commands
from lfobench.html_report.runs import SHORT_HASH, cells, provenance
from lfobench.html_report.verdict import BOOTSTRAP, design, how, pairs_how, sentence, verdict
from lfobench.plots.figure import looks
from lfobench.record import Failure, Record, Warning
from lfobench.score import Statistic
from lfobench.stats.highlight import DEFAULT_RULE, Rule
from lfobench.tables.building import build_table
from lfobench.tables.exporters.html import table_context, table_style, template_file, templates
from lfobench.tables.footnote import highlight_notes, seeds_note
from lfobench.tables.table import HIGHLIGHT_NOTE, LOST, Table
from lfobench.text import counted, harmless_lines

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
    drawn = panels(table, records)
    style, script = table_style() + template_file(__package__, "page.css"), template_file(__package__, "page.js")
    return (
        templates(PackageLoader(__package__))
        .get_template("page.html")
        .render(
            table_context(table),
            title=title,
            facts=_facts(table, records, now),
            policy=_policy(style, script),
            style=Markup(style),
            script=Markup(script),
            views=as_json(payload(knobs_of(table))),
            rule=rule,
            choices=choices(table),
            knob_notes=dict.fromkeys(highlight_notes(table), "highlight"),
            verdict=verdict(table),
            bootstrap=BOOTSTRAP,
            panels=drawn,
            looks=looks([column for column in table.columns if column.run_here], methods),
            dashes=dashes,
            curves_caption=curves_caption(table, records, drawn),
            provenance=provenance(table, records),
            number_of_runs=len(records),
            short_hash=SHORT_HASH,
            failures=failures,
            diverged_runs=[record for record in records if record.status == "diverged"],
            warnings=_warnings(records, warnings),
            run_name=_run_name,
            commands=commands(records, failures, table.statistic, rule, filters),
        )
        + "\n"
    )


def payload(knobs: Knobs) -> dict[str, Any]:
    """The view of each setting of the knobs; equal texts are stored once."""
    texts: dict[str, int] = {}
    views = {_key(rule): _view(decided, texts) for rule, decided in knobs.tables.items()}
    return {
        "labels": {"highlight": HIGHLIGHT_NOTE, "lost": LOST},
        "unavailable": {f"{test} {scope}": reason for (test, scope), reason in knobs.obstacles.items()},
        "positions": [index for index, column in enumerate(knobs.table.columns) if column.run_here],
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

    competing = in_scope(table)
    rows = [
        [cell for column, cell in zip(table.columns, row.cells, strict=True) if column.run_here]
        for _, row in table.rows()
    ]
    return {
        "verdict": place(sentence(table)),
        "how": place(how(table)),
        "design": place(design(table)),
        "pairsHow": place(pairs_how(table.rule)),
        "seeds": place(seeds_note(table).text),
        "notes": [[note.label, place(note.text)] for note in highlight_notes(table)],
        "highlighted": [[index for index, cell in enumerate(row) if cell and cell.highlighted] for row in rows],
        "lost": [[index for index, cell in enumerate(row) if cell and cell.lost] for row in rows],
        "pairs": [
            list(each.by_verdict.values()) if {each.first, each.second} <= competing else None
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


def _facts(table: Table, records: Sequence[Record], now: datetime | None) -> list[str]:
    tasks, methods = sum(1 for _ in table.rows()), sum(column.run_here for column in table.columns)
    return [
        f"{counted(tasks, 'task')} × {counted(methods, 'method')}",
        f"{len(records)} runs",
        f"source {table.source}",
        f"protocol {table.protocol}",
        *([f"made {now:%Y-%m-%d %H:%M %Z}".rstrip()] if now else []),
    ]


def _policy(style: str, script: str) -> str:
    """Content security: this style and this script alone."""

    def digest(text: str) -> str:
        return f"sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}"

    return (
        f"default-src 'none'; style-src '{digest(style)}'; script-src '{digest(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )


def _warnings(records: Sequence[Record], warnings: Sequence[Warning]) -> dict[str, list[str]]:
    """Runs by the warning that they carry; none for a warning of the folder."""
    concerned: dict[str, list[str]] = {f"{warning.what} {warning.remedy}": [] for warning in warnings}
    for record in records:
        for warning in record.warnings:
            concerned.setdefault(f"{warning.what} {warning.remedy}", []).append(_run_name(record))
    return concerned


def _run_name(run: Record | Failure) -> str:
    return f"{run.method} on {run.task}, seed {run.seed}"
