"""`run --rerun`: trained anew, and nothing lost."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest
from helpers_cli import InProcess, assert_refused
from helpers_engine import POLE_TASK, TINY
from helpers_plugins import records_in

import lfobench
from lfobench.files import locked
from lfobench.record import Record
from lfobench.records.folder import ASIDE, read_record

ON_POLE = ("--suite", TINY, "--tasks", POLE_TASK, "--protocol", "smoke")


@pytest.fixture(autouse=True)
def hasty_probe(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a plan takes is not asked here."""
    monkeypatch.setattr("lfobench.engine.probe.PROBE_SECONDS", 1e-9)


@pytest.fixture
def trained(tmp_path: Path, lfobench_command: InProcess) -> Path:
    """Two seeds of bc."""
    out = tmp_path / "runs"
    assert lfobench_command(*RERUN, "--out", out).code == 0
    return out


RERUN = ("run", "--methods", "bc", *ON_POLE, "--seeds", "0-1", "--workers", "1")


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_rerun_trains_anew_and_keeps_what_was_there(trained: Path, lfobench_command: InProcess) -> None:
    before = files(trained)
    measured = [record.measured() for record in records_in(trained)]
    planned = lfobench_command(*RERUN, "--rerun", "--dry-run", "--out", trained)
    assert "2 runs done before" in planned.out and "2 of 2 runs" in planned.out
    assert files(trained) == before, "a dry run moves nothing"
    assert lfobench_command(*RERUN, "--seeds", "1", "--rerun", "--out", trained).code == 0
    (aside,) = (trained / ASIDE).iterdir()
    moved = files(aside)
    assert {name.split("/")[0] for name in moved} == {"records", "policies"}
    assert len(moved) == 2 and all("-seed1-" in name for name in moved)
    assert moved.items() <= before.items(), "byte for byte"
    assert [record.measured() for record in records_in(trained)] == measured
    assert len(list((trained / "policies").rglob("*.safetensors"))) == 2
    assert lfobench.load(trained)["seed"].nunique() == 2
    assert len(lfobench.load(aside)) == len(records_in(trained)[1].evaluations), (
        "what was set aside is a folder of records"
    )
    explained = json.loads(lfobench_command("why", *RERUN[1:-2], "--out", trained, "--json").out)
    assert [(each["reused"], len(each["aside"])) for each in explained] == [(True, 0), (True, 1)]
    assert Path(explained[1]["aside"][0]).is_relative_to(aside)
    assert lfobench_command(*RERUN, "--rerun", "--out", trained).code == 0
    assert len(list((trained / ASIDE).rglob("*.json"))) == 3, "nothing that was set aside is written over"


def test_copies_and_damaged_records_are_set_aside_too(trained: Path, lfobench_command: InProcess) -> None:
    path = next((trained / "records").rglob("*-seed0-*.json"))
    (trained / "copy").mkdir()
    (trained / "copy" / path.name).write_bytes(path.read_bytes())
    damaged = next((trained / "records").rglob("*-seed1-*.json"))
    damaged.write_text("{", encoding="utf-8")
    assert lfobench_command(*RERUN, "--rerun", "--out", trained).code == 0
    assert len(records_in(trained)) == 2
    assert {place.parts[-2] for place in (trained / ASIDE).rglob("*.json")} == {POLE_TASK, "copy"}


def test_a_run_without_rerun_redoes_nothing(trained: Path, lfobench_command: InProcess) -> None:
    before = files(trained)
    assert lfobench_command(*RERUN, "--out", trained).code == 0
    assert files(trained) == before


def test_what_another_process_trains_is_left_alone(trained: Path, lfobench_command: InProcess) -> None:
    before = files(trained)
    name = next((trained / "records").rglob("*-seed0-*.json")).stem
    (trained / "checkpoints").mkdir(exist_ok=True)
    with locked(trained / "checkpoints" / f"{name}.lock", "--out"):
        refused = lfobench_command(*RERUN, "--rerun", "--out", trained)
    assert_refused(refused, "Another process trains", "seed 0")
    assert files(trained).items() >= before.items()


class Killed(BaseException):
    """The process is gone."""


@pytest.mark.parametrize("after", range(5))
def test_a_kill_while_things_are_set_aside_loses_nothing(
    after: int, trained: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = sorted(files(trained).values())
    moves = Path.rename
    made: list[Path] = []

    def rename(path: Path, target: Path) -> Path:
        if len(made) == after:
            raise Killed
        made.append(path)
        return moves(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", rename)
        with contextlib.suppress(Killed):
            lfobench_command(*RERUN, "--rerun", "--out", trained)
    found = files(trained)
    assert set(kept) <= set(found.values())
    for record in (path for path in (trained / "records").rglob("*.json")):
        assert isinstance(read_record(record), Record)
    assert lfobench_command(*RERUN, "--rerun", "--out", trained).code == 0
    assert set(kept) <= set(files(trained).values())
    assert len(records_in(trained)) == 2
