"""``lfobench compare`` as a user meets it: what it prints, where, and the exit code of the gate."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from helpers_cli import InProcess, assert_refused
from helpers_folders import write_crash, write_records
from helpers_records import make_cell, make_record

from lfobench.record import Record

GOOD, BAD = [100.0, 101.0, 99.0], [50.0, 51.0, 49.0]


def version(scores: list[float], number: int = 2, **options: Any) -> list[Record]:
    return make_cell(scores, method_version=number, **options)


@pytest.fixture
def before(tmp_path: Path) -> Path:
    return write_records(tmp_path / "before", [*version(GOOD, 1), *version([40.0, 60.0], 1, method="bc")])


def after(tmp_path: Path, *records: Record) -> Path:
    return write_records(tmp_path / "after", records)


def test_a_regression_is_exit_code_1(before: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    worse = after(tmp_path, *version(BAD), *version([40.0, 60.0], method="bc"))
    outcome = lfobench_command("compare", before, worse)
    assert outcome.code == 1
    assert "B against A: worse on 1 cell, undecided on 1, better on 0" in outcome.out
    assert "method_version: 1 → 2" in outcome.out
    assert outcome.err == ""
    assert lfobench_command("compare", worse, before).code == 0


def test_the_same_records_are_identical_and_exit_code_0(
    before: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    copy = after(tmp_path, *version(GOOD, 1), *version([40.0, 60.0], 1, method="bc"))
    for other in (before, copy):
        outcome = lfobench_command("compare", before, other)
        assert outcome.code == 0
        assert "identical 2" in outcome.out


def test_json_is_json_and_nothing_else(before: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("compare", before, after(tmp_path, *version(BAD)), "--json")
    value = json.loads(outcome.out)
    assert (outcome.code, value["regressed"], value["kind"]) == (1, True, "folders")
    assert [cell["column"] for cell in value["only_in_reference"]] == ["bc"]


def test_vanished_cells_are_warnings_on_standard_error(
    before: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    folder = after(tmp_path, *version(GOOD))
    outcome = lfobench_command("compare", before, folder)
    assert outcome.code == 0
    assert "Warning" in outcome.err and "bc on hopper-random-expert" in outcome.err
    write_crash(folder, make_record(0.0, "bc", method_version=2))
    assert "every seed crashed" in lfobench_command("compare", before, folder).err


def test_a_blind_gate_says_so(before: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    folder = after(tmp_path, *version(BAD), *version([1.0, 2.0], method="bc"))
    outcome = lfobench_command("compare", before, folder, "--test", "permutation")
    assert outcome.code == 0
    assert "cannot find anything" in outcome.err
    single = after(tmp_path / "single", *version([1.0]), *version([1.0], method="bc"))
    outcome = lfobench_command("compare", before, single)
    assert outcome.code == 0
    assert "no cell has two seeds" in outcome.err
    assert "untested (2)" in outcome.out


def test_other_conditions_are_refused_until_allowed(before: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    moved = after(tmp_path, *version(BAD, simulator={"gymnasium": "1.4.0", "mujoco": "9.9.9"}))
    assert_refused(lfobench_command("compare", before, moved), "simulator.mujoco", "9.9.9", "--allow simulator.mujoco")
    outcome = lfobench_command("compare", before, moved, "--allow", "simulator", "--allow", "data")
    assert outcome.code == 1
    assert "simulator.mujoco" in outcome.out
    assert_refused(lfobench_command("compare", before, moved, "--allow", "simulatr"), "Did you mean 'simulator'?")


def test_two_methods_of_a_folder(before: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("compare", "bc", "dilo", "--out", before)
    assert outcome.code == 0
    assert "bc against dilo: better on 0 tasks" in outcome.out
    value = json.loads(lfobench_command("compare", "dilo", "bc", "--out", before, "--correction", "none", "--json").out)
    assert (value["kind"], value["subject"], value["rule"]["correction"]) == ("methods", "dilo", "none")


def test_a_methods_defeat_is_no_failure(before: Path, lfobench_command: InProcess) -> None:
    folder = write_records(before, make_cell(BAD, "oril"))
    outcome = lfobench_command("compare", "oril", "dilo", "--out", folder)
    assert (outcome.code, "worse on 1" in outcome.out) == (0, True)


def test_names_and_folders_that_do_not_do(before: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    assert_refused(lfobench_command("compare", "dilo", "dillo", "--out", before), "dillo", "Did you mean 'dilo'?")
    assert_refused(lfobench_command("compare", "dilo", before, "--out", before), "'dilo' is no folder", "two folders")
    assert_refused(lfobench_command("compare", before, tmp_path / "gone"), "gone' is no folder")
    assert_refused(lfobench_command("compare", tmp_path / "gone", "dilo"), "gone' is no folder")
    assert_refused(lfobench_command("compare", "x" * 300, "dilo", "--out", before), "Unknown method")
    (tmp_path / "empty").mkdir()
    assert_refused(lfobench_command("compare", before, tmp_path / "empty"), "empty holds no records")
    elsewhere = after(tmp_path, *version(GOOD, row="ant"))
    assert_refused(lfobench_command("compare", before, elsewhere), "no cell in common")
    assert_refused(lfobench_command("compare", "dilo", "bc", "--out", before, "--allow", "data"), "--allow")
    assert_refused(lfobench_command("compare", "dilo", "bc", "--out", before, "--test", "welsh"), "welch")
    assert_refused(lfobench_command("compare", "dilo", "bc", "--out", before, "--alpha", "0"), "alpha = 0")
