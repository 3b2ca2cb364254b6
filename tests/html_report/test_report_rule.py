"""The page's rule without a browser: on the numbers embedded in the page it decides as the command line does."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, get_args

import pytest
from helpers_records import endings, make_counted

import lfobench.html_report
from lfobench.html_report.curves import column_looks, panels
from lfobench.html_report.evidence import Evidence, gather
from lfobench.html_report.page import as_json, payload
from lfobench.html_report.verdict import how, sentence
from lfobench.record import Failure, Record
from lfobench.stats.highlight import DEFAULT_RULE, Rule
from lfobench.stats.options import Correction, Scope
from lfobench.tables.building import build_table
from lfobench.tables.footnote import highlight_notes

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="no node")

DECIDE = """
const { evidence, rules } = JSON.parse(require("fs").readFileSync(0, "utf-8"));
const answers = rules.map((rule) => {
  const outcomes = highlights(evidence, rule);
  return {
    outcomes: outcomes.map(({ outcome, methods, lost, p }) => [outcome, [...methods].sort(), lost, p]),
    notes: highlightNotes(evidence, rule, outcomes),
    pairs: evidence.pairs.map((_, pair) => countPair(evidence, pair, rule)),
    verdict: verdictSentence(evidence, rule, outcomes),
    how: howDecided(evidence, rule, outcomes),
  };
});
process.stdout.write(JSON.stringify(answers));
"""


def decided_by_the_page(evidence: Evidence, records: Sequence[Record], rules: Sequence[Rule]) -> list[dict[str, Any]]:
    table = evidence.table
    value = json.loads(as_json(payload(evidence, panels(table, records), column_looks(table, ()))))
    asked = [
        {"test": each.test, "scope": each.scope, "correction": each.correction, "alpha": each.alpha} for each in rules
    ]
    script = (Path(lfobench.html_report.__file__).parent / "rule.js").read_text(encoding="utf-8") + DECIDE
    done = subprocess.run(
        ["node", "-e", script],
        input=json.dumps({"evidence": value, "rules": asked}),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answers: list[dict[str, Any]] = json.loads(done.stdout)
    return answers


def decided_here(evidence: Evidence) -> dict[str, Any]:
    places = {column: index for index, column in enumerate(evidence.columns)}
    cells = [
        [
            (places[column], cell)
            for column, cell in zip(evidence.table.columns, row.cells, strict=True)
            if column in places
        ]
        for row in evidence.rows
    ]
    counts = [evidence.count(pair) for pair in range(len(evidence.pairs))]
    return {
        "outcomes": [
            [
                row.outcome,
                [place for place, cell in of_row if cell and cell.highlighted],
                [place for place, cell in of_row if cell and cell.lost],
                row.p,
            ]
            for row, of_row in zip(evidence.rows, cells, strict=True)
        ],
        "notes": [[note.label, note.text] for note in highlight_notes(evidence.table)],
        "pairs": [
            {name: getattr(each, name) for name in ("better", "worse", "undecided", "untested")} for each in counts
        ],
        "verdict": sentence(evidence.table),
        "how": how(evidence.table),
    }


def assert_alike(records: Sequence[Record], failures: Sequence[Failure], first: Rule) -> set[str]:
    """Every setting of the knobs of a page that opens with `first`; returns the outcomes and the notes' labels."""
    evidence = gather(build_table(records, rule=first, failures=failures))
    knobs = product(evidence.tests, get_args(Scope), get_args(Correction), (0.05, 0.3))
    rules = [Rule(*knob) for knob in knobs if (knob[0], knob[1]) not in evidence.unavailable]
    seen = set()
    statistic = evidence.table.statistic
    for rule, answer in zip(rules, decided_by_the_page(evidence, records, rules), strict=True):
        table = build_table(records, statistic, rule, failures=failures)
        here = decided_here(replace(evidence, table=table))
        assert {key: answer[key] for key in here if key != "notes"} == {
            key: here[key] for key in here if key != "notes"
        }
        assert dict(answer["notes"]) == dict(here["notes"])
        seen |= {row.outcome for row in evidence.rows} | {outcome for outcome, *_ in answer["outcomes"]}
        seen |= {label for label, _ in answer["notes"]}
    return seen


def test_scores(records: list[Record], failures: list[Failure]) -> None:
    seen = assert_alike(records, failures, DEFAULT_RULE)
    assert seen >= {"better", "undecided", "untested", "unopposed", "Pairs", "†", "Design"}


def test_counts() -> None:
    records = [
        make_counted(endings(successes, 10), endings(further, 20), method, seed, row)
        for row, of_row in (
            ("clear", {"dilo": (9, 18), "bco": (1, 3), "oril": (1, 3)}),
            ("close", {"dilo": (5, 9), "bco": (5, 8), "oril": (0, 0)}),
            ("hopeless", {"dilo": (0, 0), "bco": (0, 0), "oril": (0, 0)}),
            ("alone", {"dilo": (3, 4)}),
            ("steady", {"dilo": (10, 20), "bco": (5, 10)}),
        )
        for method, (most, further) in of_row.items()
        for seed in range(3)
        for successes in [most if row == "steady" else max(0, most - seed % 2)]
    ]
    seen = assert_alike(records, [], Rule("fisher"))
    assert seen >= {"better", "undecided", "unopposed", "all failed", "No spread", "Pairs"}
