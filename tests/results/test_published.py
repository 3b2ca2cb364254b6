"""The shipped publication, and what follows from its numbers: the facts that ``lfobench audit dilo-2024`` prints."""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path

import pytest

from lfobench.records.publication import TableOfCounts, TableOfMeans
from lfobench.records.published import read_publication
from lfobench.stats.audit import CountsAudit, CountsRule, CountTest, MeansAudit, audit_counts, audit_means
from lfobench.stats.highlight import Rule
from lfobench.stats.options import Test

FOLDER = Path(__file__).parents[2] / "results" / "published" / "dilo-2024"
ROWS = 24
METHODS = ("rce", "bc-expert", "bc", "iqlearn", "recoil", "oril", "smodice", "dilo", "expert")
WINNERS = 16

PUBLICATION = read_publication("dilo-2024")


def means(title: str) -> TableOfMeans:
    table = next(table for table in PUBLICATION.tables if table.title == title)
    assert isinstance(table, TableOfMeans)
    return table


def robot_table() -> TableOfCounts:
    table = next(table for table in PUBLICATION.tables if isinstance(table, TableOfCounts))
    assert len(table.rows) == 10
    return table


def table_1(test: Test = "welch") -> MeansAudit:
    table = means("Table 1")
    return audit_means(table, table.compared, Rule(test))


def robot(test: CountTest) -> CountsAudit:
    return audit_counts(robot_table(), robot_table().compared, CountsRule(test))


# --- the transcription -----------------------------------------------------------------------------------------------


def test_table_1_is_complete() -> None:
    table = means("Table 1")
    assert len(table.rows) == ROWS
    assert all(tuple(row.cells) == METHODS for row in table.rows)
    assert table.compared == ("oril", "smodice", "dilo")
    for row in table.rows:
        judged = {method for method, cell in row.cells.items() if cell.highlighted is not None}
        assert judged == set(table.compared)


def test_table_1_can_stand_beside_our_records() -> None:
    table = means("Table 1")
    assert (table.source, table.protocol) == ("d4rl", "paper")
    assert [claim.n for claim in table.claims] == [5, 7]
    assert table.rows[0].name == "hopper-random-expert"


def test_the_robomimic_table_holds_rates() -> None:
    table = means("Robomimic table")
    assert len(table.rows) == 8
    assert table.rows[0].place == {"observations": "state", "demos": "50", "dataset": "lift-mg"}
    assert all(0.0 <= cell.mean <= 1.0 for row in table.rows for cell in row.cells.values())


def test_provenance_describes_every_file_and_its_columns() -> None:
    provenance = tomllib.loads((FOLDER / "provenance.toml").read_text(encoding="utf-8"))
    entries = [entry for entry in provenance.values() if isinstance(entry, dict)]
    assert {entry["file"] for entry in entries} == {path.name for path in FOLDER.glob("*.csv")}
    assert provenance["url"] == "https://arxiv.org/abs/2406.08805v2"
    for entry in entries:
        with (FOLDER / entry["file"]).open(newline="", encoding="utf-8") as file:
            header = next(csv.reader(file))
        assert header[: len(entry["row"])] == entry["row"]


# --- what follows ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("test", ["welch", "student"])
def test_the_rule_gives_every_highlight_of_table_1(test: Test) -> None:
    audit = table_1(test)
    assert [at_n.n for at_n in audit.by_n] == [5, 7]
    for at_n in audit.by_n:
        assert [row.follows for row in at_n.rows] == [True] * ROWS
        assert len(at_n.winners) == WINNERS
        assert {tuple(row.ruled) for row in at_n.winners} == {("dilo",)}


def test_what_a_correction_leaves_of_table_1() -> None:
    five, seven = table_1().by_n
    assert [row.name for row in five.lost("holm")] == [
        "halfcheetah-random-expert",
        "hopper-random-few-expert",
        "walker2d-medium-expert",
        "kitchen-partial-expert",
    ]
    assert [row.name for row in seven.lost("holm")] == ["kitchen-partial-expert"]
    assert five.lost("bh") == seven.lost("bh") == []


def test_students_test_loses_one_row_less() -> None:
    five, seven = table_1("student").by_n
    assert [row.name for row in five.lost("holm")] == [
        "halfcheetah-random-expert",
        "walker2d-medium-expert",
        "kitchen-partial-expert",
    ]
    assert [row.name for row in seven.lost("holm")] == ["kitchen-partial-expert"]


def test_who_competes_decides_the_highlights() -> None:
    """RCE sees states only, but is printed in the other group."""
    audit = audit_means(means("Table 1"), ("rce", "oril", "smodice", "dilo"), Rule())
    walker = next(row for row in audit.by_n[0].rows if row.name == "walker2d-medium-expert")
    assert walker.follows is False
    assert walker.ruled == {"rce"}


def test_the_robomimic_highlights_follow_for_any_usual_n() -> None:
    table = means("Robomimic table")
    audit = audit_means(table, table.compared, Rule())
    assert audit.by_n == ()
    assert set(range(3, 11)) <= set(audit.reproducing)


def test_no_row_of_the_robot_table_is_significant_by_fisher() -> None:
    audit = robot("fisher")
    assert {row.outcome for row in audit.rows} == {"undecided"}
    assert audit.closest is not None and audit.closest.p is not None
    assert audit.closest.name == "dynamic-hitting-400-expert-hit"
    assert round(audit.closest.p, 3) == 0.057
    assert all(row.merely_largest for row in audit.rows)


def test_boschloo_tells_three_rows_apart_and_holm_leaves_none() -> None:
    audit = robot("boschloo")
    assert [row.name for row in audit.rows if row.outcome == "better"] == [
        "safe-manipulation-few-trajectories",
        "dynamic-hitting-400-expert-touch",
        "dynamic-hitting-400-expert-hit",
    ]
    assert all(row.holm is not None and row.holm >= 0.05 for row in audit.rows)


def test_wilsons_interval_of_8_of_10() -> None:
    interval = robot("fisher").rows[0].intervals["dilo"]
    assert (round(interval.low, 2), round(interval.high, 2)) == (0.49, 0.94)


def test_contradictions_of_the_numbers() -> None:
    texts = [found.text for found in table_1().contradictions]
    assert texts[0] == "n is 5 by the caption and 7 by the appendix"
    impossible = [text for text in texts[1:] if "have the mean printed" in text]
    assert len(impossible) == len(texts) - 1 == 2
    # Scored in quarters over ten episodes, 48.33 takes three seeds, or a multiple.
    assert all("kitchen-mixed-expert smodice 48.33 (fits n = 3, 6, 9)" in text for text in impossible)
    # The authors' own method: five seeds could have given it, seven could not.
    assert "dilo 43" not in impossible[0]
    assert "kitchen-partial-expert dilo 43 (fits n = 5, 9, 10)" in impossible[1]
    assert robot("fisher").contradictions == ()


def test_contradictions_of_the_text_are_kept() -> None:
    assert "puck striking, trials" in {stated.about for stated in PUBLICATION.contradictions}
