"""What the page's knobs can show is what the command line says under the same rule."""

from __future__ import annotations

import json
import re
from itertools import product
from typing import Any

from helpers_records import endings, make_counted

from lfobench.html_report.knobs import ALPHAS, knobs_of
from lfobench.html_report.knobs import tests_of as offered
from lfobench.html_report.page import report
from lfobench.html_report.verdict import how, sentence
from lfobench.record import Failure, Record
from lfobench.stats.highlight import Rule
from lfobench.tables.building import build_table
from lfobench.tables.exporters.html import template_file
from lfobench.tables.footnote import CORRECTIONS, SCOPES, highlight_notes
from lfobench.text import harmless_lines


def embedded(page: str) -> dict[str, Any]:
    (text,) = re.findall(r"<script[^>]*application/json[^>]*>(.*?)</script>", page, re.DOTALL)
    found: dict[str, Any] = json.loads(text)
    return found


def shown(page: dict[str, Any], rule: Rule) -> dict[str, Any]:
    view = page["views"][f"{rule.test} {rule.scope} {rule.correction} {rule.alpha!r}"]
    texts = page["texts"]
    return {
        "verdict": texts[view["verdict"]],
        "how": texts[view["how"]],
        "notes": [[label, texts[text]] for label, text in view["notes"]],
        "highlighted": view["highlighted"],
        "lost": view["lost"],
    }


def expected(records: list[Record], failures: list[Failure], rule: Rule) -> dict[str, Any]:
    table = build_table(records, rule=rule, failures=failures)
    cells = [
        [cell for column, cell in zip(table.columns, row.cells, strict=True) if column.run_here]
        for _, row in table.rows()
    ]
    return {
        "verdict": harmless_lines(sentence(table)),
        "how": how(table),
        "notes": [[note.label, harmless_lines(note.text)] for note in highlight_notes(table)],
        "highlighted": [[place for place, cell in enumerate(row) if cell and cell.highlighted] for row in cells],
        "lost": [[place for place, cell in enumerate(row) if cell and cell.lost] for row in cells],
    }


def test_every_setting_shows_what_the_table_says(records: list[Record], failures: list[Failure]) -> None:
    page = embedded(report(records, failures))
    table = build_table(records, failures=failures)
    for settings in product(offered(table), SCOPES, CORRECTIONS, (0.05, 0.001)):
        rule = Rule(*settings)
        if f"{rule.test} {rule.scope}" in page["unavailable"]:
            continue
        assert shown(page, rule) == expected(records, failures, rule), rule


def test_counts_are_decided_by_fisher_and_by_scores() -> None:
    records = [
        make_counted(endings(successes, 10), endings(further, 20), method, seed)
        for method, (successes, further) in {"dilo": (9, 18), "bco": (1, 3), "oril": (1, 3)}.items()
        for seed in range(3)
    ]
    page = embedded(report(records, rule=Rule("fisher")))
    assert {key.split()[0] for key in page["views"]} >= {"fisher", "welch"}
    rule = Rule("fisher", correction="holm", alpha=0.01)
    assert shown(page, rule) == expected(records, [], rule)


def test_the_level_that_a_page_opens_with_is_among_its_choices(records: list[Record]) -> None:
    table = build_table(records, rule=Rule(alpha=0.02))
    assert {rule.alpha for rule in knobs_of(table).tables} == {*ALPHAS, 0.02}


def test_a_test_that_cannot_be_made_says_why(records: list[Record]) -> None:
    uneven = [
        record
        if record.seed
        else record.model_copy(
            update={
                "evaluations": [
                    each.model_copy(update={"returns": each.returns[:1], "lengths": each.lengths[:1]})
                    for each in record.evaluations
                ]
            }
        )
        for record in records
    ]
    found = knobs_of(build_table(uneven))
    for (test, scope), reason in found.obstacles.items():
        assert reason and not any((rule.test, rule.scope) == (test, scope) for rule in found.tables)


def test_the_script_holds_no_rule() -> None:
    assert not re.search(r"holm|fisher|0\.05", template_file("lfobench.html_report", "page.js"))
