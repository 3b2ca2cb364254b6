"""Tasks of somebody else's environment, from a suite file and its neighbours to a table: actions in other boxes."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers_cli import InProcess, assert_refused

from lfobench.store.folder import RecordFolder

OWN = str(Path(__file__).parents[1] / "own_folder" / "own_suite.py")


def of(task: str, *methods: str) -> tuple[str, ...]:
    return ("--methods", ",".join(methods or ("bc",)), "--suite", OWN, "--tasks", task, "--protocol", "smoke")


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
