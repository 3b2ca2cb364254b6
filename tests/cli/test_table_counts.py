"""``lfobench table`` of records that count successes, and every other view of them."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import pytest
from helpers_cli import InProcess, assert_refused
from helpers_folders import with_provenance, write_records
from helpers_records import endings, make_cell, make_counted
from rich.console import Console

import lfobench
from lfobench import api
from lfobench.tables.exporters.terminal import terminal

TASKS = (("safe-manipulation", "few-trajectories"), ("puck-striking", "20-expert"))


@pytest.fixture
def counted(tmp_path: Path) -> Path:
    """Three seeds of two methods on two tasks; one seed diverged."""
    records = [
        make_counted(
            endings(successes + seed, starts, "cup hit"),
            endings(10 * successes, 100, "stalled"),
            method,
            seed,
            row,
            group,
            diverged_at=1500 if (method, seed, row) == ("bco", 2, "puck-striking") else None,
        )
        for (row, group), starts in zip(TASKS, (10, 11), strict=True)
        for method, successes in (("dilo", 8), ("bco", 2))
        for seed in range(3)
    ]
    return write_records(tmp_path / "counted", [with_provenance(each, demonstration_score=100.0) for each in records])


def flat(text: str) -> str:
    return " ".join(text.split())


def test_counts_are_the_default(counted: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("table", "--out", counted)
    assert (outcome.code, outcome.err) == (0, "")
    # 8 + 9 + 10 of the fixed starts and 3 · 80 of the further ones.
    assert "267/330 [76, 85]*" in outcome.out
    assert "Fisher's exact two-sided test" in flat(outcome.out)
    assert "Counts are tested because every record says how its episodes ended" in flat(outcome.out)
    asked = lfobench_command("table", "--out", counted, "--test", "fisher")
    assert asked.out == outcome.out


def test_a_narrow_terminal_gets_rates_and_a_wide_one_counts(counted: Path) -> None:
    def printed(width: int, wide: bool) -> str:
        console = Console(file=io.StringIO(), width=width, color_system=None)
        console.print(terminal(api.table(counted), wide))
        assert isinstance(console.file, io.StringIO)
        return console.file.getvalue()

    assert "81%*" in printed(50, wide=False) and "267/330" not in printed(50, wide=False)
    assert "267/330 [76, 85]*" in printed(50, wide=True)


def test_welch_shows_scores_as_ever(counted: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("table", "--out", counted, "--test", "welch", "--stat", "last", "--format", "csv")
    lines = list(csv.DictReader(io.StringIO(outcome.out)))
    dilo = next(line for line in lines if (line["method"], line["row"]) == ("dilo", "safe-manipulation"))
    assert (dilo["mean"], dilo["std"], dilo["test"]) == ("90.0", "10.0", "welch")
    assert "successes" not in dilo
    shown = lfobench_command("table", "--out", counted, "--test", "welch", "--stat", "last")
    assert "90.0 ± 10.0" in shown.out
    assert "success rate in %" in flat(shown.out)


def test_one_record_without_outcomes_brings_scores_back(counted: Path, lfobench_command: InProcess) -> None:
    write_records(counted, make_cell([1.0, 2.0], protocol=make_counted(endings(1, 2)).identity["protocol"]))
    outcome = lfobench_command("table", "--out", counted)
    assert outcome.code == 0
    assert "Welch's two-sided t-test" in flat(outcome.out)
    assert "because some records do not say how their episodes ended" in flat(outcome.out)
    assert "267/330" in lfobench_command("table", "--out", counted, "--suite", "airhockey").out
    refused = lfobench_command("table", "--out", counted, "--test", "fisher")
    assert_refused(refused, "2 of 14 records do not say how their episodes ended", "hopper-random-expert", "--suite")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--test", "fischer"), ("Unknown test 'fischer'", "Did you mean 'fisher'")),
        (("--stat", "best", "--test", "fisher"), ("--stat best", "last evaluation", "--test welch")),
        (("--against", "dilo-2024"), ("not comparable with dilo-2024, Robot table", "simulated", "--anyway")),
        (("--against", "dilo-2024", "--test", "welch"), ("counts successes on these tasks", "Leave out --test")),
        (("--outcomes", "--format", "html"), ("no format 'html'", "terminal, markdown")),
        (("--outcomes", "--alpha", "0.1"), ("--alpha plays no part",)),
        (("--outcomes", "--test", "welch"), ("--test plays no part",)),
        (("--outcomes", "--against", "dilo-2024"), ("--against plays no part",)),
    ],
    ids=" ".join,
)
def test_mistakes_are_one_line(
    options: tuple[str, ...], words: tuple[str, ...], counted: Path, lfobench_command: InProcess
) -> None:
    outcome = lfobench_command("table", "--out", counted, *options)
    assert_refused(outcome, *words)
    assert outcome.out == ""


def test_the_robot_beside_the_simulation(counted: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("table", "--out", counted, "--against", "dilo-2024", "--anyway", "--wide")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Published, not comparable" in outcome.out
    assert "8/10 [49, 94] ∼ p " in outcome.out
    found = json.loads(
        lfobench_command("table", "--out", counted, "--against", "dilo-2024", "--anyway", "--format", "json").out
    )
    verdicts = [cell["agreement"] for row in found["rows"] for cell in row["cells"][-2:]]
    assert set(verdicts) == {"differs", "not told apart"}


@pytest.mark.parametrize("format_name", ["terminal", "markdown", "latex", "csv", "json"])
def test_outcomes_in_every_format_that_has_them(format_name: str, counted: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("table", "--out", counted, "--outcomes", "--format", format_name, "--methods", "dilo")
    assert (outcome.code, outcome.err) == (0, "")
    for word in ("cup hit", "stalled", "267"):
        assert word in outcome.out
    assert not re.search(r"\bbco\b", outcome.out)


def test_outcomes_of_scores_are_refused(tmp_path: Path, lfobench_command: InProcess) -> None:
    folder = write_records(tmp_path / "scores", make_cell([1.0, 2.0]))
    assert_refused(lfobench_command("table", "--out", folder, "--outcomes"), "2 of 2 records", "--suite or --methods")


def test_from_python(counted: Path) -> None:
    assert lfobench.table(counted).counts
    assert not lfobench.table(counted, test="welch").counts
    assert "267/330" in lfobench.table(counted)._repr_html_()
    assert api.outcomes(counted).outcomes == ("success", "stalled", "cup hit", "diverged")


# --- other views -----------------------------------------------------------------------------------------------------


def test_the_other_views_count_too(counted: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    page = tmp_path / "report.html"
    assert lfobench_command("report", "--out", counted, "--to", page).code == 0
    text = page.read_text(encoding="utf-8")
    assert "success rate in %" in text and "267/330" in text and "exact two-sided test of the pooled counts" in text
    compared = lfobench_command("compare", "dilo", "bco", "--out", counted)
    assert compared.code == 0 and "dilo against bco: better on" in compared.out
    assert "267/330" in compared.out and "Intervals of a difference are Newcombe's" in flat(compared.out)
    assert "variance inflation by seeds" in flat(compared.out)
    same = lfobench_command("compare", counted, counted)
    assert (same.code, "identical 4" in same.out) == (0, True)
    planned = lfobench_command("power", "--out", counted)
    assert planned.code == 0 and "seeds per method" in planned.out


@pytest.mark.parametrize("kind", ["curves", "scores"])
def test_plots_of_success_rates(kind: str, counted: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("plot", kind, "--out", counted, "--to", tmp_path / "plot.svg")
    assert outcome.code == 0
    assert "The score is the success rate in per cent" in outcome.out
    assert "random actions" not in outcome.out


def test_a_plan_of_seeds_refuses_the_test_of_episodes(counted: Path, lfobench_command: InProcess) -> None:
    assert_refused(lfobench_command("power", "--out", counted, "--test", "fisher"), "'fisher' counts episodes", "welch")


@pytest.mark.parametrize("command", [("compare", "dilo", "bco"), ("report",), ("table",)], ids=" ".join)
def test_counts_of_records_that_do_not_say_are_refused_everywhere(
    command: tuple[str, ...], tmp_path: Path, lfobench_command: InProcess
) -> None:
    folder = write_records(tmp_path / "scores", [*make_cell([1.0, 2.0]), *make_cell([1.0, 2.0], "bco")])
    for options in (("--test", "fisher"), ("--stat", "success")):
        refused = lfobench_command(*command, "--out", folder, *options)
        assert_refused(refused, "do not say how their episodes ended", "--test welch")


def test_a_changed_further_episode_is_a_changed_run(counted: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    """Two folders of one run are identical only if the episodes from further starts are, too."""
    one = make_counted(endings(8, 10), endings(80, 100))
    other = make_counted(endings(8, 10), endings(79, 100))
    assert one.identity_hash == other.identity_hash
    folders = [write_records(tmp_path / name, [record]) for name, record in (("one", one), ("other", other))]
    assert "identical" not in lfobench_command("compare", *folders).out


def test_the_starts_of_a_publication_are_a_subset(tmp_path: Path, lfobench_command: InProcess) -> None:
    records = [
        make_counted([*endings(4, 10), *endings(successes, 40)], endings(50, 50), method, seed)
        for method, successes in (("dilo", 30), ("bco", 2))
        for seed in range(2)
    ]
    marked = [
        each.model_copy(update={"labels": each.labels.model_copy(update={"published_starts": 10})}) for each in records
    ]
    folder = write_records(tmp_path / "marked", marked)
    counts = {
        starts: [cell["successes"]["all"] for cell in json.loads(found.out)["rows"][0]["cells"]]
        for starts in ("all", "published")
        if (found := lfobench_command("table", "--out", folder, "--starts", starts, "--format", "json"))
    }
    assert counts["published"] == [{"successes": 8, "trials": 20}] * 2
    assert [count["trials"] for count in counts["all"]] == [200, 200]
    assert "from each of the 10 fixed test starts." in flat(
        lfobench_command("table", "--out", folder, "--starts", "published").out
    )
    assert_refused(lfobench_command("table", "--out", folder, "--starts", "paper"), "published")


def test_records_without_a_publications_starts_are_refused(counted: Path, lfobench_command: InProcess) -> None:
    assert_refused(lfobench_command("table", "--out", counted, "--starts", "published"), "--starts")
