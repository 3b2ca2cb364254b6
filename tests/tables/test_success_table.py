"""A table of success counts in every format, and what its footnote says of them."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from helpers_folders import with_provenance
from helpers_records import endings, make_cell, make_counted
from rich.console import Console
from test_comma_separated import HEADER
from test_html_table import rows as html_rows
from test_latex import compiled

from lfobench.record import Failure, Record
from lfobench.stats.highlight import Rule
from lfobench.stats.successes import fisher_test
from lfobench.tables.building import build_table
from lfobench.tables.exporters import export
from lfobench.tables.exporters.terminal import terminal
from lfobench.tables.table import Table, cell_text

FISHER = Rule("fisher")

COUNTS = (
    "successes,trials,rate_low,rate_high,fixed_successes,fixed_trials,variance_inflation,seed_successes,seed_trials,"
    "agreement_p"
)


def cell(successes: Sequence[int], method: str = "dilo", further: int = 0, **options: object) -> list[Record]:
    """Ten fixed starts a seed, and as many further ones as asked for, of which every second succeeds."""
    return [
        make_counted(endings(each, 10), endings(further // 2, further), method, seed, **options)  # type: ignore[arg-type]
        for seed, each in enumerate(successes)
    ]


@pytest.fixture
def table() -> Table:
    """A winner, a tie, a diverged and a failed seed, a missing cell and the demonstration."""
    records = [
        *cell([9, 10, 8]),
        *cell([2, 0, 1], "bco"),
        *cell([5, 5, 5], group="fixed-start"),
        *cell([5, 4, 5], "bco", group="fixed-start"),
        *cell([10, 10], group="few-uniform"),
        make_counted(endings(0, 10), seed=2, group="few-uniform", diverged_at=40),
    ]
    crashed = make_counted(endings(0, 10), method="bco", seed=7)
    failure = Failure(identity_hash="f", identity=crashed.identity, labels=crashed.labels, error="gone", traceback=[])
    shown = [with_provenance(record, demonstration_score=100.0) for record in records]
    return build_table(shown, rule=FISHER, failures=[failure])


def notes(table: Table) -> dict[str, str]:
    return {note.label: note.text for note in table.notes}


def drawn(table: Table, width: int = 120) -> str:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    console.print(terminal(table))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_cells_read_as_counts_with_their_interval(table: Table) -> None:
    (_, row), *_ = table.rows()
    texts = [str(cell_text(each)) for each in row.cells if each]
    assert texts == ["27/30 [74, 97]", "3/30 [3, 26] !1", "100.0"]
    assert cell_text(build_table(cell([10] * 7), rule=FISHER).blocks[0].rows[0].cells[0]).interval == "[95, 100]"  # type: ignore[arg-type]


def test_the_terminal_aligns_counts_and_intervals(table: Table) -> None:
    body = drawn(table).partition("\n\n")[0].splitlines()
    lines = [line for line in body if "/30" in line]
    assert len(lines) == 3
    assert [re.findall(r"\d+/30 +\[ *\d+, \d+\]\*?", line) for line in lines] == [
        ["27/30 [74, 97]*", "3/30  [3, 26]"],
        ["15/30 [33, 67]*", "14/30 [30, 64]*"],
        ["20/30 [49, 81]"],
    ]
    assert len({line.index("/30") for line in lines}) == 1
    assert len({line.index("]") for line in lines}) == 1


def test_the_highlight_is_fishers(table: Table) -> None:
    first, second, third = (row for _, row in table.rows())
    assert (first.outcome, first.p) == ("better", pytest.approx(fisher_test(27, 30, 3, 30)))
    assert (second.outcome, second.p) == ("undecided", pytest.approx(fisher_test(15, 30, 14, 30)))
    assert (third.outcome, third.p) == ("unopposed", None)


def test_markdown_and_html_show_the_same_text(table: Table) -> None:
    text = export(table, "markdown")
    assert "| **27/30 [74, 97]** | 3/30 [3, 26] !1 | 100.0 |" in text
    assert "20/30 [49, 81] ✗1" in text
    found = html_rows(export(table, "html"))
    assert [row[2][1].split(" (")[0] for row in found] == ["27/30 [74, 97]", "15/30 [33, 67]", "20/30 [49, 81]✗1"]
    assert 'data-value="90.0"' in found[0][2][0], "columns are sorted by rate"
    assert ["highlighted" in row[2][0] for row in found] == [True, True, False]


def test_csv_has_the_counts_behind_the_known_columns(table: Table) -> None:
    text = export(table, "csv")
    assert text.splitlines()[0] == f"{HEADER},{COUNTS}"
    lines = list(csv.DictReader(io.StringIO(text)))
    dilo = lines[0]
    assert (dilo["successes"], dilo["trials"], dilo["fixed_successes"], dilo["fixed_trials"]) == (
        "27",
        "30",
        "27",
        "30",
    )
    assert (dilo["seed_successes"], dilo["seed_trials"], dilo["test"]) == ("9 10 8", "10 10 10", "fisher")
    assert float(dilo["rate_low"]) < 0.9 < float(dilo["rate_high"])
    demonstration = lines[2]
    assert demonstration["mean"] == "100.0"
    assert {demonstration[name] for name in COUNTS.split(",")} == {""}
    assert export(build_table(cell([1, 2])), "csv").splitlines()[0] == HEADER


def test_json_keeps_fixed_and_all_apart() -> None:
    found = json.loads(export(build_table(cell([9, 8], further=100), rule=FISHER), "json"))
    counts = found["rows"][0]["cells"][0]["successes"]
    assert counts["fixed"] == {"successes": 17, "trials": 20}
    assert counts["all"] == {"successes": 117, "trials": 220}
    assert counts["seeds"] == [{"successes": 59, "trials": 110}, {"successes": 58, "trials": 110}]
    assert counts["interval"][0] < 117 / 220 < counts["interval"][1]
    assert counts["variance_inflation"] == pytest.approx(0.0, abs=0.1)
    plain = json.loads(export(build_table(cell([9, 8])), "json"))
    assert "successes" not in plain["rows"][0]["cells"][0]


def test_latex_has_a_macro_for_the_interval(table: Table) -> None:
    text = export(table, "latex")
    assert r"\providecommand{\lfobenchinterval}[2]" in text
    assert r"\lfobenchbest{$27/30\lfobenchinterval{74}{97}$}" in text
    assert r"$3/30\lfobenchinterval{\phantom{0}3}{26}$" in text
    assert r"\lfobenchinterval" not in export(build_table(make_cell([1.0, 2.0])), "latex")


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no TeX engine")
def test_latex_compiles(table: Table, tmp_path: Path) -> None:
    assert "Missing character" not in compiled(table, tmp_path)


# --- the footnote ----------------------------------------------------------------------------------------------------


def test_it_says_what_is_pooled_and_why_counts_are_tested() -> None:
    text = notes(build_table([*cell([9, 8], further=100), *cell([1, 2], "bco", further=100)], rule=FISHER))
    assert "Wilson's 95% interval" in text["Score"]
    assert "10 fixed test starts and 100 further ones" in text["Score"]
    assert "best success rate" in text["Highlighted"] and "Fisher's exact two-sided test" in text["Highlighted"]
    assert "further" not in notes(build_table(cell([9, 8]), rule=FISHER))["Score"]


def test_it_names_the_largest_variance_inflation() -> None:
    records = [*cell([10, 0, 10, 0]), *cell([5, 5, 5, 6], "bco")]
    text = notes(build_table(records, rule=FISHER))["Episodes"]
    assert "13.3, dilo on safe-manipulation-few-trajectories." in text
    assert "Rao and Scott 1992" in text
    assert text.endswith("--test welch takes seeds as the unit.")
    for unknown in (cell([5]), cell([10, 10])):
        assert "is unknown" in notes(build_table(unknown, rule=FISHER))["Episodes"]


def test_it_says_what_a_diverged_seed_counts_as(table: Table) -> None:
    assert (
        "every episode of which counts as a failure: dilo on safe-manipulation-few-uniform, seed 2"
        in (notes(table)["Diverged"])
    )


def test_one_seed_is_tested_and_said_to_be_one() -> None:
    text = notes(build_table([*cell([9]), *cell([1], "bco")], rule=FISHER))
    assert text["Seeds"] == "n = 1 per cell (seeds 0)."
    assert "Not tested" not in text["Highlighted"]


def test_too_few_episodes_are_said() -> None:
    records = [make_counted(endings(each, 2), method=method) for method, each in (("dilo", 2), ("bco", 0))]
    text = notes(build_table(records, rule=FISHER))["Design"]
    assert text.startswith("with 2 episodes, Fisher's exact two-sided test of the pooled counts gives at best p = 0.33")
    assert "Design" not in notes(build_table([*cell([9]), *cell([1], "bco")], rule=FISHER))


def test_scores_of_counting_records_are_success_rates_and_the_choice_is_said() -> None:
    text = notes(build_table([*cell([9, 8]), *cell([1, 2], "bco")]))
    assert text["Score"].startswith("success rate in % of the episodes from the fixed test starts; mean ±")
    assert "without --stat and --test" in text["Score"]
    assert "Episodes" not in text
    mixed = notes(build_table([*cell([9, 8]), *make_cell([1.0, 2.0])]))["Score"]
    assert mixed.startswith("normalised return")
    assert mixed.endswith("because some records do not say how their episodes ended.")
    assert notes(build_table(make_cell([1.0] * 5)))["Score"].endswith("last 5 evaluations.")


def test_the_demonstration_is_a_success_rate(table: Table) -> None:
    assert notes(table)["Demonstration"] == (
        "the mean success rate in % of the expert trajectories that the methods observe."
    )
