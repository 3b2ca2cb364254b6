"""``lfobench power`` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers_cli import InProcess, assert_refused
from helpers_folders import with_provenance, write_records
from helpers_records import make_cell
from scipy.stats import ttest_ind

from lfobench.stats.power import seeds_needed_for


@pytest.fixture
def pilot(tmp_path: Path) -> Path:
    records = [
        *make_cell([60.0, 70.0, 65.0]),
        *make_cell([50.0, 52.0, 51.0], "smodice"),
        *make_cell([10.0, 12.0, 14.0], "bco"),
    ]
    times = {"train": 3000.0, "evaluate": 600.0}
    return write_records(tmp_path / "pilot", [with_provenance(record, seconds=times) for record in records])


def test_seeds_points_and_hours(pilot: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("power", "--out", pilot, "--effect", "10", "--seeds", "5")
    assert outcome.code == 0
    assert "To see 10 points with power 0.8" in outcome.out
    assert "dilo, smodice" in outcome.out
    assert "5 seeds everywhere: 4 more runs, 4.0 h with 1 worker" in outcome.out
    assert "2.0 h with 2 workers" in lfobench_command("power", "--out", pilot, "--workers", "2").out


def test_json_and_chosen_methods(pilot: Path, lfobench_command: InProcess) -> None:
    value = json.loads(lfobench_command("power", "--out", pilot, "--methods", "bco,smodice", "--json").out)
    (task,) = value["tasks"]
    assert [method["column"] for method in task["methods"]] == ["smodice", "bco"]
    assert value["design"]["can_show_anything"] is True
    assert task["pilot"]["seeds_needed"]["alone"] == seeds_needed_for(10.0, 1.0, 2.0)


def test_a_smaller_effect_needs_more_seeds(pilot: Path, lfobench_command: InProcess) -> None:
    def needed(effect: str) -> int:
        value = json.loads(lfobench_command("power", "--out", pilot, "--effect", effect, "--json").out)
        return int(value["tasks"][0]["pilot"]["seeds_needed"]["alone"])

    assert needed("2") > needed("5") > needed("10")


def test_a_design_that_shows_nothing(pilot: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("power", "--out", pilot, "--test", "mann-whitney", "--seeds", "3")
    assert outcome.code == 0
    assert "nothing can come out significant" in outcome.out


def test_what_cannot_be_planned(pilot: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    assert_refused(lfobench_command("power", "--out", pilot, "--effect", "0"), "--effect")
    assert_refused(lfobench_command("power", "--out", pilot, "--power", "1"), "--power")
    assert_refused(lfobench_command("power", "--out", pilot, "--methods", "dilo,smodise"), "Did you mean 'smodice'?")
    assert_refused(lfobench_command("power", "--out", pilot, "--methods", "dilo"), "two methods")
    assert_refused(lfobench_command("power", "--out", tmp_path / "gone"), "No folder")
    (tmp_path / "empty").mkdir()
    assert_refused(lfobench_command("power", "--out", tmp_path / "empty"), "holds no records")


def test_the_seeds_are_those_of_welchs_test_and_not_of_students(tmp_path: Path, lfobench_command: InProcess) -> None:
    """Spreads of 3.25 and 10 points: with three seeds Welch's test has power 0.70, not the 0.80 of Student's."""
    scores = (50.0 - 3.25, 50.0, 50.0 + 3.25)
    out = write_records(tmp_path / "pilot", [*make_cell(scores), *make_cell(scores, "smodice")])
    planned = lfobench_command("power", "--out", out, "--effect", "10", "--seeds", "3", "--json")
    (task,) = json.loads(planned.out)["tasks"]
    assert [method["std"] for method in task["methods"]] == pytest.approx([3.25, 3.25])
    assert task["pilot"]["seeds_needed"]["alone"] == 4
    random = np.random.default_rng(0)
    seen = {
        n: np.mean(
            ttest_ind(
                random.normal(10.0, 3.25, (40_000, n)), random.normal(0.0, 3.25, (40_000, n)), axis=1, equal_var=False
            ).pvalue
            < 0.05
        )
        for n in (3, 4)
    }
    assert seen[3] == pytest.approx(0.70, abs=0.01) and seen[4] > 0.8
