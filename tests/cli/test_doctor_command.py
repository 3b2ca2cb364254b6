"""``lfobench data doctor`` on small files: text, JSON, picture, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers_cli import InProcess, assert_refused
from helpers_files import make_episodes, write_d4rl


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return write_d4rl(tmp_path / "small.hdf5", make_episodes())


def test_a_file_is_described(file: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("data", "doctor", file, "--horizon", 9)
    assert outcome.code == 0
    text = " ".join(outcome.out.split())
    assert "small.hdf5: d4rl layout, 20 transitions in 3 episodes of 4 to 9 (median 7) steps" in text
    assert "(1 terminated, 2 cut by time); 4 observations, 2 actions; return" in text
    assert "released pairs" in text and "exact triples" in text
    assert "caution 1 episode was cut by time before the horizon of 9 steps." in text


def test_json_and_picture(file: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("data", "doctor", file, "--json", "--to", tmp_path / "episodes.svg")
    found = json.loads(outcome.out)
    assert (found["format"], found["usable"], found["lengths"]) == ("d4rl", True, [7, 4, 9])
    assert {mode["name"]: mode["kept"] for mode in found["modes"]}["exact pairs"] == 20
    drawn = (tmp_path / "episodes.svg").read_text("utf-8")
    assert "<svg" in drawn and "20 transitions in 3 episodes" in drawn


def test_what_cannot_be_trained_on_exits_with_1(file: Path, lfobench_command: InProcess) -> None:
    with h5py.File(file, "a") as opened:
        opened["actions"][3] = np.nan
    outcome = lfobench_command("data", "doctor", file)
    assert outcome.code == 1
    assert "problem  1 row of actions has a NaN or an infinity." in outcome.out


def test_what_is_no_data_is_refused(tmp_path: Path, lfobench_command: InProcess) -> None:
    page = tmp_path / "page.hdf5"
    page.write_text("<html>Log in</html>")
    assert_refused(lfobench_command("data", "doctor", page), str(page), "it is a web page", "Download it again")
    assert_refused(lfobench_command("data", "doctor", tmp_path / "none.hdf5"), "No such file")
    assert_refused(lfobench_command("data", "doctor", page, "--to", tmp_path / "a.gif"), "End the name in .png")
    task = ("data", "doctor", "hopper-random-expert")
    assert_refused(lfobench_command(*task, "--horizon", 5), "--horizon, --keys and --to are for a file")
