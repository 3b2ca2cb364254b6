"""Somebody else's environment and files, from a suite file and its neighbours to a table: boxes, demonstrations."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers_cli import InProcess, assert_refused
from helpers_files import make_episodes, write_d4rl

from lfobench.records.folder import RecordFolder

OWN = str(Path(__file__).parents[1] / "own_folder" / "own_suite.py")


def of(task: str, *methods: str) -> tuple[str, ...]:
    return ("--methods", ",".join(methods or ("bc",)), "--suite", OWN, "--tasks", task, "--protocol", "smoke")


@pytest.mark.slow
def test_a_box_is_named_in_plan_record_and_footnote(
    tmp_path: Path, shared_cache: Path, lfobench_command: InProcess
) -> None:
    """In worker processes, too, which import the suite's neighbours by themselves."""
    run = ("run", *of("cart-two,cart-one", "bc-expert"), "--out", tmp_path, "--workers", "2")
    plan = lfobench_command(*run, "--dry-run")
    assert plan.code == 0
    assert "actions   in [-2, 2], scaled from and to a method's [-1, 1]: cart-two\n" in plan.out
    boxes = json.loads(lfobench_command(*run, "--dry-run", "--json").out)["action_boxes"]
    assert boxes == {"cart-two": {"low": [-2.0], "high": [2.0]}}
    assert lfobench_command(*run).code == 0
    records = {record.task: record for record in RecordFolder(tmp_path).read_all().records}
    assert records["cart-two"].identity["action_box"] == {"low": [-2.0], "high": [2.0]}
    assert "action_box" not in records["cart-one"].identity
    assert not records["cart-two"].warnings
    table = lfobench_command("table", "--out", tmp_path, "--format", "json")
    assert "[-2, 2], scaled from and to a method's [-1, 1]" in table.out


@pytest.mark.parametrize(
    "task",
    [
        *("cart-discrete", "cart-multidiscrete", "cart-dict", "cart-whole", "cart-grid"),
        *("cart-two-dict", "cart-two-image", "cart-two-discrete", "cart-two-tuple", "cart-two-scalar"),
    ],
)
def test_other_spaces_are_refused_before_anything_is_made(
    task: str, tmp_path: Path, lfobench_command: InProcess
) -> None:
    out = tmp_path / "runs"
    assert_refused(lfobench_command("run", *of(task), "--out", out), task, "Cart-v0", "flat vectors")
    assert not out.exists()


@pytest.mark.parametrize("task", ["cart-unbounded", "cart-half"])
def test_a_box_without_bounds_is_said_in_plan_and_record(
    task: str, tmp_path: Path, lfobench_command: InProcess
) -> None:
    run = ("run", *of(task), "--seeds", "0", "--workers", "1", "--out", tmp_path)
    plan = lfobench_command(*run, "--dry-run")
    assert "lack bounds" in plan.err and "inf" in plan.err
    done = lfobench_command(*run)
    assert done.code == 0
    (record,) = RecordFolder(tmp_path).read_all().records
    said = " ".join(warning.what for warning in record.warnings)
    assert "lack bounds" in said
    assert "leave [-1, 1]" in said and "the farthest to 5" in said


def write(path: Path, actions: np.ndarray, length: int = 20) -> None:
    ends = np.zeros(len(actions), bool)
    ends[length - 1 :: length] = True
    with h5py.File(path, "w") as file:
        file["observations"] = np.random.default_rng(0).normal(size=(len(actions), 2)).astype(np.float32)
        file["actions"] = actions.astype(np.float32)
        file["rewards"] = np.zeros(len(actions), np.float32)
        file["terminals"] = np.zeros(len(actions), bool)
        file["timeouts"] = ends


@pytest.mark.parametrize(("largest", "leaving"), [(2.0, 0), (2.5, 200)])
def test_actions_of_files_that_leave_the_box_are_said_before_training_and_in_the_record(
    largest: float, leaving: int, tmp_path: Path, lfobench_command: InProcess
) -> None:
    path = tmp_path / "mine.hdf5"
    write(path, np.tile([[-largest], [0.5]], (200, 1)))
    run = ("run", *of("cart-two"), "--seeds", "0", "--workers", "1", "--source", f"offline={path}", "--out", tmp_path)
    done = lfobench_command(*run)
    assert done.code == 0
    (record,) = RecordFolder(tmp_path).read_all().records
    said = [warning.what for warning in record.warnings if "leave" in warning.what]
    assert len(said) == bool(leaving)
    for what in said:
        assert "200 actions of 400 in the offline part" in what and "[-2, 2]" in what and "1.25" in what
        assert done.err.index(what[:40]) < done.err.index("seed 0: score")


OWN_RECIPES = """
from lfobench.contract.suite import Environment, Files, Recipe, Suite, Task, own_file
CART = Environment("cart", "Pendulum-v1", 1000, -1500.0, 0.0)
FILES = {{"mine": Files(own_file("{folder}/mine.hdf5"), own_file("{folder}/theirs.hdf5"))}}
RECIPES = {{"counted": Recipe("mine", 1_000_000, "theirs", 2, demonstrations=2),
           "default": Recipe("mine", 1_000_000, "theirs", 30),
           "recorded": Recipe.recorded("mine", 4, "theirs", 3)}}
SUITE = Suite("mine", "files", tuple(Task(n, "mine", CART, r, 20, files=FILES) for n, r in RECIPES.items()), None)
"""


@pytest.fixture
def own_recipes(tmp_path: Path) -> Path:
    """Files of 200-step episodes in an environment whose episodes are cut later."""
    for name, count in (("mine", 6), ("theirs", 5)):
        episodes = make_episodes([200] * count, [False] * count, 3, 1)
        write_d4rl(tmp_path / f"{name}.hdf5", replace(episodes, actions=2.0 * episodes.actions))
    path = tmp_path / "mine.py"
    path.write_text(OWN_RECIPES.format(folder=tmp_path), encoding="utf-8")
    return path


@pytest.mark.slow
def test_every_method_sees_the_same_demonstrations_of_own_files(
    tmp_path: Path, own_recipes: Path, lfobench_command: InProcess
) -> None:
    run = ("run", "--suite", own_recipes, "--methods", "dilo,smodice,bco", "--protocol", "smoke", "--seeds", "0")
    done = lfobench_command(*run, "--workers", "1", "--out", tmp_path / "runs")
    assert done.code == 0, done.err
    records = RecordFolder(tmp_path / "runs").read_all().records
    assert len(records) == 9
    for record in records:
        assert record.identity["action_box"] == {"low": [-2.0], "high": [2.0]}
        counts = {"counted": (2, 2), "default": (1, 2), "recorded": None}[record.task]
        found = record.counts and (record.counts.demonstrations, record.counts.expert_trajectories)
        assert found == counts, (record.method, record.task)
        said = " ".join(warning.what for warning in record.warnings)
        assert "leave" not in said and "demonstration" not in said
    lines = {record.task: record.identity["recipe"] for record in records}
    assert lines["recorded"]["expert_trajectories"] == 3 and lines["recorded"]["offline_trajectories"] == 4
    table = json.loads(lfobench_command("table", "--out", tmp_path / "runs", "--format", "json").out)
    source = next(note["text"] for note in table["notes"] if note["label"] == "Source")
    assert "Expert data: 1 or 2 trajectories, observations only" in source
    assert "Expert data, observations only: 3 theirs trajectories" in source
