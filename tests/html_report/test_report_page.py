"""The page as text: complete, well formed, closed to what records may hold, equal for equal input."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from datetime import UTC, datetime
from html.parser import HTMLParser
from itertools import pairwise
from typing import Any, get_args

import pytest
from helpers_records import make_cell
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.html_report.curves import ticks
from lfobench.html_report.knobs import pair_counts
from lfobench.html_report.page import as_json, report
from lfobench.html_report.verdict import sentence, verdict
from lfobench.record import Failure, Record, Warning
from lfobench.stats.contrast import contrast
from lfobench.stats.highlight import Rule
from lfobench.stats.options import Correction
from lfobench.tables.building import build_table
from lfobench.text import harmless_lines

VOID = {"br", "col", "input", "meta"}


class Balance(HTMLParser):
    """Fails where an element is not closed in its turn; gathers text, attributes and scripts."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.contents: dict[str, list[str]] = {}
        self.text = ""
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attributes]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("script", "style"):
            self.contents.setdefault(self.open[-1], []).append(data)
        else:
            self.text += data


@pytest.fixture(scope="module")
def page(records: list[Record], failures: list[Failure]) -> str:
    return report(records, failures, [Warning(what="A file <b>was</b> skipped.", remedy="Move it away.")])


@pytest.fixture(scope="module")
def read(page: str) -> Balance:
    return Balance(page)


def test_the_page_is_a_function_of_its_arguments(page: str, records: list[Record], failures: list[Failure]) -> None:
    again = report(records, failures, [Warning(what="A file <b>was</b> skipped.", remedy="Move it away.")])
    assert again == page
    assert "made 20" not in page
    dated = report(make_cell([1.0, 2.0]), now=datetime(2026, 11, 25, 8, 30, tzinfo=UTC))
    assert "made 2026-11-25 08:30 UTC" in dated


def test_names_and_messages_are_text(read: Balance) -> None:
    assert len(read.contents["script"]) == 2
    assert {tag for tag, _, _ in read.attributes} & {"img", "iframe", "object", "embed", "link", "base"} == set()
    assert not [name for _, name, _ in read.attributes if name.startswith("on") or name == "style"]
    assert "</script><img src=x onerror=alert(1)> is odd. Look at it." in read.text
    assert "RuntimeError: </script><img src=x onerror=alert(1)>" in read.text
    assert "A file <b>was</b> skipped. Move it away." in read.text
    assert "\u202e" not in read.text


def test_nothing_is_loaded_and_only_the_page_s_own_script_runs(read: Balance) -> None:
    links = [value for _, name, value in read.attributes if name in ("href", "src", "action", "xlink:href")]
    assert all(link.startswith("#") for link in links)
    targets = {value for _, name, value in read.attributes if name == "id"}
    assert {link[1:] for link in links} <= targets
    assert not re.search(r"url\(|@import|https?:", "".join(read.contents["style"]))
    policy = next(value for tag, name, value in read.attributes if tag == "meta" and "default-src" in value)
    assert policy.startswith("default-src 'none'")
    for text in (*read.contents["style"], read.contents["script"][1]):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy


def test_ids_are_unique(read: Balance) -> None:
    ids = [value for _, name, value in read.attributes if name == "id"]
    assert len(set(ids)) == len(ids)


def test_every_run_is_listed_with_its_identity(read: Balance, page: str, records: list[Record]) -> None:
    for record in records:
        assert f"seed {record.seed}: {record.identity_hash}" in read.text
    assert page.count('href="#identity-') == len(records)
    assert "diverged at 500" in read.text
    assert "0123456789ab" in read.text


TEXTS = st.text(st.characters() | st.sampled_from("<>&/!-\u2028\u2029"), max_size=20).map(harmless_lines)
JSON_VALUES = st.recursive(
    st.none() | st.integers(-5, 5) | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=6,
)


@given(JSON_VALUES)
@settings(max_examples=60)
def test_embedded_json_holds_nothing_that_could_end_it(value: Any) -> None:
    text = as_json(value)
    assert not re.search("[<>&\u2028\u2029]", text)
    assert json.loads(text) == value


@pytest.mark.parametrize("correction", get_args(Correction))
def test_pairs_are_counted_as_compare_counts_them(records: list[Record], correction: Correction) -> None:
    rule = Rule(test="student", scope="all", correction=correction, alpha=0.05)
    table = build_table(records, rule=rule)
    for counts in pair_counts(table):
        first, second = (table.columns.index(side) for side in (counts.first, counts.second))
        cells = {
            row.task: (one.sample, two.sample)
            for _, row in table.rows()
            if (one := row.cells[first]) and (two := row.cells[second]) and one.sample and two.sample
        }
        judged = contrast(cells, rule, replicates=2)
        assert {
            "better": counts.better,
            "worse": counts.worse,
            "undecided": counts.undecided,
            "untested": counts.untested,
        } == {name: len(judged.having(name)) for name in ("better", "worse", "undecided", "untested")}


def test_the_verdict_says_better_undecided_and_untested() -> None:
    records = [
        *make_cell([90.0, 91.0, 92.0], "dilo"),
        *make_cell([50.0, 51.0, 52.0], "smodice"),
        *make_cell([50.0, 70.0, 60.0], "dilo", row="ant"),
        *make_cell([52.0, 69.0, 58.0], "smodice", row="ant"),
        *make_cell([50.0], "dilo", row="walker"),
        *make_cell([40.0], "smodice", row="walker"),
    ]
    assert sentence(build_table(records)) == (
        "Among the methods without expert actions, on 3 tasks: better than the second best: dilo on 1; "
        "undecided on 1; not tested on 1."
    )
    alone = make_cell([90.0, 91.0], "dilo")
    assert sentence(build_table(alone)).endswith("on 1 task: nothing to compare on 1.")


def test_one_task_has_no_aggregate_and_the_page_says_so() -> None:
    records = [*make_cell([90.0, 91.0, 92.0], "dilo"), *make_cell([50.0, 51.0, 52.0], "smodice")]
    found = verdict(build_table(records))
    assert found.aggregates is None
    assert [pair.improvement for pair in found.pairs] == [""]
    assert "Aggregates over tasks are left out" in found.limits[1]
    assert "Interquartile mean" not in report(records)


def test_two_tasks_have_aggregates_and_the_tasks_left_out_are_named() -> None:
    records = [
        record
        for row in ("hopper", "ant")
        for method in ("dilo", "smodice")
        for record in make_cell([90.0, 91.0], method, row=row)
    ]
    found = verdict(build_table([*records, *make_cell([1.0], "dilo", row="walker")]))
    assert found.aggregates and found.aggregates.tasks == 2
    assert set(found.aggregates.means) == {"dilo", "smodice"}
    assert "leave out walker-random-expert" in found.limits[1]


def test_a_design_that_can_show_nothing_is_named_first() -> None:
    records = [*make_cell([90.0, 91.0], "dilo"), *make_cell([50.0, 51.0], "smodice")]
    found = verdict(build_table(records, rule=Rule(test="permutation")))
    assert "no row could have come out significant" in found.design


@given(st.floats(-1e4, 1e4), st.floats(1e-2, 1e5))
@settings(max_examples=60)
def test_ticks_are_even_few_and_inside(low: float, width: float) -> None:
    found = ticks(low, low + width)
    assert 1 <= len(found) <= 6
    assert all(low - 1e-6 * width <= tick <= low + width + 1e-6 * width for tick in found)
    steps = [after - before for before, after in pairwise(found)]
    assert all(step == pytest.approx(steps[0]) for step in steps)
