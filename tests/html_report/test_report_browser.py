"""The page in a real browser: what its script decides is what the command line decides."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, get_args

import pytest
from helpers_records import make_cell
from PIL import Image

from lfobench.html_report.knobs import in_scope, pair_counts
from lfobench.html_report.page import report
from lfobench.html_report.reproduction import knob_options
from lfobench.html_report.verdict import design, how, pairs_how, sentence
from lfobench.record import Failure, Record
from lfobench.stats.highlight import DEFAULT_RULE, Rule
from lfobench.stats.options import Correction, Scope, Test
from lfobench.tables.building import build_table
from lfobench.tables.table import Table
from lfobench.text import harmless_lines

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright (the dev extra)")

pytestmark = pytest.mark.browser

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
METHODS = ("dilo", "bc")

# What the page shows under one setting of its knobs, read back from the document.
READ = """
([test, scope, correction, alpha]) => {
  const form = document.getElementById("knobs");
  Object.assign(form.elements.test, { value: test });
  Object.assign(form.elements.scope, { value: scope });
  Object.assign(form.elements.correction, { value: correction });
  form.elements.alpha.value = alpha;
  form.dispatchEvent(new Event("input", { bubbles: true }));
  const text = (id) => document.getElementById(id).textContent;
  const cells = [...document.querySelectorAll("#scores td[data-column]")];
  const place = (cell) => [Number(cell.parentNode.dataset.row), Number(cell.dataset.column)];
  return {
    highlighted: cells.filter((cell) => cell.classList.contains("highlighted")).map(place),
    lost: cells.filter((cell) => cell.textContent.includes("†")).map(place),
    notes: [...document.querySelectorAll("#notes div")].map((each) =>
      [each.querySelector("dt").textContent, each.querySelector("dd").textContent]),
    verdict: text("verdict"),
    how: text("how"),
    pairsHow: text("pairs-how"),
    design: text("design"),
    pairs: [...document.querySelectorAll("[data-pair]")].filter((row) => !row.hidden).map((row) =>
      [...row.querySelectorAll("[data-count]")].map((cell) => Number(cell.textContent))),
    status: text("status"),
    commands: [...document.querySelectorAll(".knob-options")].map((span) => span.textContent),
  };
}
"""


@dataclass
class Visit:
    """A page that is open, and everything that it did besides being read."""

    page: Any
    trouble: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, records: list[Record], failures: list[Failure]) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(report(records, failures, methods=METHODS), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is installed")
    # A browser refuses to build its sandbox for root.
    sandbox = not (hasattr(os, "geteuid") and os.geteuid() == 0)
    with playwright.sync_playwright() as started:
        launched = started.chromium.launch(executable_path=program, chromium_sandbox=sandbox)
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def opened(browser: Any, file: Path) -> Iterator[Visit]:
    yield from visit(browser, file)


def visit(browser: Any, file: Path, **options: Any) -> Iterator[Visit]:
    context = browser.new_context(viewport={"width": 1280, "height": 900}, **options)
    visiting = Visit(context.new_page())
    page, trouble = visiting.page, visiting.trouble
    page.on("console", lambda message: trouble.append(f"console: {message.text}"))
    page.on("pageerror", lambda error: trouble.append(f"error: {error}"))
    page.on("dialog", lambda dialog: (trouble.append(f"dialog: {dialog.message}"), dialog.dismiss()))
    page.on("request", lambda request: trouble.append(request.url) if request.url != file.as_uri() else None)
    page.goto(file.as_uri())
    yield visiting
    context.close()
    assert trouble == []


@pytest.fixture
def page(opened: Visit) -> Any:
    """The page with its knobs, order and scroll position as at first."""
    opened.page.reload()
    return opened.page


def test_every_setting_of_the_knobs_decides_as_the_command_line(
    opened: Visit, records: list[Record], failures: list[Failure]
) -> None:
    settings = product(get_args(Test), get_args(Scope), get_args(Correction), (0.05, 0.001))
    outcomes, labels, lost = set(), set(), 0
    for test, scope, correction, alpha in settings:
        rule = Rule(test, scope, correction, alpha)
        decided = build_table(records, rule=rule, methods=METHODS, failures=failures)
        found = opened.page.evaluate(READ, [test, scope, correction, repr(alpha)])
        assert found == expected(decided), rule
        outcomes |= {row.outcome for _, row in decided.rows()}
        labels |= {note.label for note in decided.notes}
        lost += len(found["lost"])
    assert outcomes == {"better", "undecided", "untested", "unopposed"}
    assert labels >= {"Pairs", "†", "Design"}
    assert lost


def expected(table: Table) -> dict[str, Any]:
    cells = [
        ([row, column], cell)
        for row, (_, each) in enumerate(table.rows())
        for column, cell in enumerate(each.cells)
        if cell is not None
    ]
    scope, counts = in_scope(table), pair_counts(table)
    return {
        "highlighted": [place for place, cell in cells if cell.highlighted],
        "lost": [place for place, cell in cells if cell.lost],
        "notes": [[harmless_lines(note.label), harmless_lines(note.text)] for note in table.notes],
        "verdict": harmless_lines(sentence(table)),
        "how": how(table),
        "pairsHow": pairs_how(table.rule),
        "design": design(table),
        "pairs": [
            [each.better, each.worse, each.undecided, each.untested]
            for each in counts
            if {each.first, each.second} <= scope
        ],
        "status": "",
        "commands": [knob_options(table.rule)] * 2,
    }


def test_a_reader_turns_the_knobs_and_resets_them(page: Any) -> None:
    before = page.locator("#verdict").inner_text()
    page.get_by_label("Scope").select_option("all")
    page.get_by_label("Test").select_option(label="Student's t-test")
    page.get_by_label("α").select_option("0.001")
    assert page.locator("#verdict").inner_text().startswith("Among all methods")
    assert "p < 0.001" in page.locator("#how").inner_text()
    assert "--test student --scope all" in page.locator(".knob-options").first.inner_text()
    page.get_by_role("button", name="Reset").click()
    page.wait_for_function("before => document.getElementById('verdict').innerText === before", arg=before)


def values(page: Any, column: int) -> list[float | None]:
    return page.eval_on_selector_all(
        f'#scores tbody td[data-column="{column}"]',
        "cells => cells.map((cell) => cell.dataset.value === undefined ? null : Number(cell.dataset.value))",
    )


def test_columns_sort_both_ways_by_mouse_and_by_keyboard(page: Any) -> None:
    heading = page.locator('#scores th[data-column="2"]')
    original = values(page, 2)
    known = [value for value in original if value is not None]
    missing = [None] * (len(original) - len(known))
    assert missing, "the column has a cell without a score"

    heading.get_by_role("button").click()
    assert heading.get_attribute("aria-sort") == "descending"
    assert values(page, 2) == sorted(known, reverse=True) + missing
    heading.get_by_role("button").press("Enter")
    assert heading.get_attribute("aria-sort") == "ascending"
    assert values(page, 2) == sorted(known) + missing
    heading.get_by_role("button").press("Space")
    assert heading.get_attribute("aria-sort") == "none"
    assert values(page, 2) == original

    page.get_by_role("button", name="Task").first.click()
    tasks = page.locator("#scores tbody .task").all_inner_texts()
    assert page.locator('#scores [aria-sort="ascending"]').count() == 1
    assert tasks[:4] == ["between", "clear", "close", "single"]


def test_sorting_the_runs_counts_numbers_as_numbers(page: Any) -> None:
    heading = page.locator("#runs-table th", has_text="Score")
    heading.get_by_role("button").click()
    read = page.eval_on_selector_all(
        "#runs-table tbody tr", "rows => rows.map((row) => Number(row.cells[4].dataset.value))"
    )
    assert read == sorted(read, reverse=True)


def test_a_highlight_stays_with_its_cell_when_sorted(page: Any) -> None:
    def highlighted() -> list[str]:
        return sorted(page.locator("#scores td.highlighted").all_inner_texts())

    before = highlighted()
    page.locator('#scores th[data-column="1"]').get_by_role("button").click()
    assert highlighted() == before
    page.get_by_label("Correction").select_option("holm")
    page.get_by_label("Correction").select_option("none")
    assert highlighted() == before


def test_curves_appear_under_the_pointer(page: Any) -> None:
    details = page.locator("#details")
    assert details.is_hidden()
    page.locator('#scores tr[data-row="1"] td[data-column="1"]').hover()
    assert details.get_by_role("heading").inner_text() == "dilo on clear-random-expert"
    assert details.locator(".seed-line").count() == 4
    assert details.locator(".mean-line").count() == 1
    assert "t-interval" in details.inner_text()
    assert "failed, not counted seed 9" in details.inner_text()
    svg = details.locator("svg")
    used = svg.evaluate("(svg) => svg.querySelector('use').getBBox().width > 200")
    assert used, "the axes of the task"
    drawn = Image.open(io.BytesIO(svg.screenshot())).convert("L")
    assert sum(drawn.histogram()[:64]) < 0.1 * drawn.width * drawn.height, "lines and labels, no black areas"
    page.locator("h1").hover()
    assert details.is_hidden()


def test_curves_appear_on_focus_and_follow_the_arrow_keys(page: Any) -> None:
    details = page.locator("#details")
    page.get_by_role("button", name="demonstration").focus()
    page.keyboard.press("Tab")
    assert details.get_by_role("heading").inner_text() == "bc on close-random-expert"
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowDown")
    assert details.get_by_role("heading").inner_text() == "dilo on clear-random-expert"
    page.keyboard.press("Escape")
    assert details.is_hidden()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Tab")
    assert details.is_hidden()


def test_names_are_text_and_nothing_else(page: Any) -> None:
    assert page.locator("img, iframe, object, base").count() == 0
    assert page.locator("script").count() == 2
    page.locator('#scores tr[data-row="0"] td[data-column="2"]').hover()
    assert page.locator("#details h3").inner_text() == "</script><img src=x onerror=alert(1)> on close-random-expert"
    assert (
        page.evaluate(
            "[...document.querySelectorAll('*')].flatMap((e) => e.getAttributeNames())"
            ".filter((name) => name.startsWith('on'))"
        )
        == []
    )


def test_a_test_that_cannot_be_made_says_so_and_changes_nothing(browser: Any, tmp_path: Path) -> None:
    file = tmp_path / "starts.html"
    records = [*make_cell([50.0, 51.0], "dilo"), *make_cell([10.0, 12.0], "smodice")]
    fewer = [each.model_copy(update={"returns": each.returns[:1]}) for each in records[-1].evaluations[:-1]]
    records[-1] = records[-1].model_copy(update={"evaluations": [*fewer, records[-1].evaluations[-1]]})
    file.write_text(report(records), encoding="utf-8")
    for visiting in visit(browser, file):
        page = visiting.page
        before = page.locator("#verdict").inner_text()
        page.get_by_label("Test").select_option("wilcoxon")
        assert page.get_by_role("status").inner_text().startswith("The test cannot be made: 'wilcoxon' needs start")
        assert page.locator("#verdict").inner_text() == before
        page.get_by_label("Test").select_option("student")
        assert page.get_by_role("status").inner_text() == ""


def test_a_tap_shows_the_curves_and_a_tap_elsewhere_hides_them(browser: Any, file: Path) -> None:
    for visiting in visit(browser, file, has_touch=True, color_scheme="dark"):
        page = visiting.page
        page.set_viewport_size({"width": 390, "height": 800})
        page.locator('#scores tr[data-row="1"] td[data-column="1"]').tap()
        assert page.locator("#details .seed-line").count() == 4
        page.locator("h1").tap()
        assert page.locator("#details").is_hidden()
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_without_its_script_the_page_is_the_table_of_the_command_line(
    browser: Any, file: Path, records: list[Record], failures: list[Failure]
) -> None:
    table = build_table(records, rule=DEFAULT_RULE, methods=METHODS, failures=failures)
    for visiting in visit(browser, file, java_script_enabled=False):
        page = visiting.page
        assert page.locator("#knobs").is_hidden()
        assert page.locator("#verdict").inner_text() == harmless_lines(sentence(table))
        assert page.locator("#scores td.highlighted").count() == sum(
            cell is not None and cell.highlighted for _, _, cell in table.cells()
        )
        assert page.locator("#curves figure svg").count() == 9
