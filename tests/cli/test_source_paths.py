"""Paths of ``--source`` that are no data: one line each, before anything is planned to run; and files that are."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
from helpers_cli import InProcess, assert_refused
from helpers_files import make_episodes, write_d4rl, write_minari, write_npz_folder

import lfobench

TINY = str(Path(__file__).parents[1] / "tiny_suite.py")


def loop(path: Path) -> None:
    path.symlink_to(path)


def long_loop(path: Path) -> None:
    path.symlink_to(path.with_name("other"))
    path.with_name("other").symlink_to(path)


def broken(path: Path) -> None:
    path.symlink_to(path.with_name("nowhere"))


def pipe(path: Path) -> None:
    os.mkfifo(path)


def empty_folder(path: Path) -> None:
    path.mkdir()


def a_folder_of_loops(path: Path) -> None:
    path.mkdir()
    loop(path / "a.npz")


def other_lerobot(path: Path) -> None:
    (path / "meta").mkdir(parents=True)
    (path / "meta" / "info.json").write_text('{"codebase_version": "v2.1"}')


def through_a_file(path: Path) -> None:
    path.symlink_to(path.with_name("file") / "below")
    path.with_name("file").touch()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (loop, "leads nowhere"),
        (long_loop, "leads nowhere"),
        (broken, "leads nowhere"),
        (through_a_file, "leads nowhere"),
        (pipe, "neither a file nor a folder"),
        (lambda path: path.symlink_to("/dev/zero"), "neither a file nor a folder"),
        (empty_folder, "a folder without"),
        (a_folder_of_loops, "a folder without"),
        (other_lerobot, "a LeRobot dataset without"),
        (lambda path: None, "No data file"),
    ],
)
def test_no_data_is_one_line_before_anything_runs(
    tmp_path: Path, make: Callable[[Path], object], said: str, lfobench_command: InProcess
) -> None:
    path = tmp_path / "mine.hdf5"
    make(path)
    run = ("run", "--suite", TINY, "--methods", "bc", "--protocol", "smoke", "--out", tmp_path / "runs")
    outcome = lfobench_command(*run, "--source", f"offline={path}", "--dry-run")
    assert_refused(outcome, str(path), said)
    assert_refused(lfobench_command("data", "doctor", path), str(path))


def test_the_doctor_takes_keys_and_folders(tmp_path: Path, lfobench_command: InProcess) -> None:
    file = write_minari(tmp_path / "file.hdf5", make_episodes(), in_dictionary=True)
    assert_refused(lfobench_command("data", "doctor", file, "--keys", "state"), "'episode_0/observations/state'")
    assert_refused(lfobench_command("data", "doctor", file, "--keys", "a+"), "does not say what an observation is made")
    assert lfobench_command("data", "doctor", file, "--keys", "observation").code == 0
    folder = write_npz_folder(tmp_path / "folder", make_episodes())
    outcome = lfobench_command("data", "doctor", folder, "--json")
    found = json.loads(outcome.out)
    assert (outcome.code, found["format"], found["lengths"]) == (0, "npz", [7, 4, 9])


def test_what_nothing_can_be_learned_from_exits_with_1(tmp_path: Path, lfobench_command: InProcess) -> None:
    file = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    assert lfobench_command("data", "doctor", file, "--horizon", 9).code == 0
    short = write_d4rl(tmp_path / "short.hdf5", make_episodes([1] * 20, [False] * 20))
    outcome = lfobench_command("data", "doctor", short, "--horizon", 9)
    assert outcome.code == 1 and "Nothing can be learned from it" in outcome.out


@pytest.mark.slow
def test_a_run_reads_chosen_keys(tmp_path: Path, lfobench_command: InProcess) -> None:
    episodes = make_episodes([40] * 30, [False] * 30, observation=4, action=1)
    file, folder = write_minari(tmp_path / "file.hdf5", episodes), write_npz_folder(tmp_path / "folder", episodes)
    with h5py.File(file, "a") as opened:
        for name in opened:
            whole = opened[name]["observations"][:]
            del opened[name]["observations"]
            opened[name]["observations/place"], opened[name]["observations/rest"] = whole[:, :1], whole[:, 1:]
    run = ("run", "--suite", TINY, "--tasks", "pole-medium-expert", "--methods", "bc", "--protocol", "smoke")
    run = (*run, "--seeds", 0)
    source = f"offline={file},expert={folder}"
    assert_refused(
        lfobench_command(*run, "--out", tmp_path / "a", "--source", source),
        "'episode_0/observations/observation' is missing (there: place, rest)",
        "keys=place+rest",
    )
    narrow = lfobench_command(*run, "--out", tmp_path / "b", "--source", f"{source},offline.keys=rest")
    assert narrow.code == 2 and "its observations have 3 columns, those of InvertedPendulum-v5 4" in narrow.err
    outcome = lfobench_command(*run, "--out", tmp_path / "c", "--source", f"{source},offline.keys=place+rest")
    assert outcome.code == 0, outcome
    assert set(lfobench.load(tmp_path / "c")["source"]) == {"files"}
