"""A method of one's own by path, and the files that `lfobench new` writes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_cli import InProcess, arguments, assert_refused, process
from helpers_engine import POLE_TASK, TINY
from helpers_plugins import forget_registrations, method_source, records_in

import lfobench
from lfobench.engine.policy import load_policy
from lfobench.errors import UserError
from lfobench.records.folder import RecordFolder

ON_POLE = ("--suite", TINY, "--tasks", POLE_TASK, "--protocol", "smoke")


@pytest.fixture(autouse=True)
def hasty_probe(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a plan takes is not asked here."""
    monkeypatch.setattr("lfobench.engine.probe.PROBE_SECONDS", 1e-9)


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A method's file whose constants are its neighbour's."""
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "rates.py").write_text("RATE = 0.1\n", encoding="utf-8")
    path = folder / "file_of_mine.py"
    path.write_text(method_source().replace("0.1 *", "RATE *") + "\nfrom rates import RATE\n", encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_method_by_path_trains_in_worker_processes(mine: Path, tmp_path: Path, shared_cache: Path) -> None:
    out = tmp_path / "runs"
    run = ("run", "--methods", f"{mine},bc", *ON_POLE, "--set", "mine.beta=0.5", "--workers", "2", "--out", out)
    outcome = process(arguments(*run), env={"LFOBENCH_CACHE": str(shared_cache)})
    assert outcome.code == 0, outcome
    found = records_in(out)
    assert [(record.method, record.seed) for record in found] == [("bc", 0), ("bc", 1), ("mine", 0), ("mine", 1)]
    assert set(found[2].identity["method_code"]) == {"file_of_mine.py", "rates.py"}
    assert found[2].identity["config"] == {"beta": 0.5}
    assert "method_code" not in found[0].identity
    table = process(arguments("table", "--out", out, "--methods", "mine", "--format", "csv"))
    assert table.code == 0 and "mine" in table.out


def test_why_names_the_file_that_was_edited(mine: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    out = tmp_path / "runs"
    command = ("--methods", mine, *ON_POLE, "--seeds", "0", "--out", out)
    assert lfobench_command("run", *command, "--workers", "1").code == 0
    (before,) = json.loads(lfobench_command("why", *command, "--json").out)
    assert before["reused"]
    (mine.parent / "rates.py").write_text("RATE = 0.2\n", encoding="utf-8")
    (after,) = json.loads(lfobench_command("why", *command, "--json").out)
    assert not after["reused"]
    (difference,) = after["differences"]
    assert difference.startswith("method_code.rates.py: ")
    assert lfobench_command("run", *command, "--workers", "1").code == 0
    assert len(records_in(out)) == 2
    first, second = records_in(out)
    assert first.evaluations != second.evaluations
    table = lfobench_command("table", "--out", out, "--format", "csv")
    assert table.code == 0, "two codes of one method are two columns"
    labels = {line.split(",")[0] for line in table.out.splitlines()[1:]} | set(table.out.split(","))
    assert len({label for label in labels if label.startswith("mine@")}) == 2
    status = json.loads(lfobench_command("status", "--out", out, "--json").out)
    assert len({cell["preset"] for cell in status["cells"] if "code " in cell["preset"]}) == 2


def test_a_file_that_is_edited_while_it_trains_stops_the_rest(
    mine: Path, tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plan was made with other code than a worker process would import."""
    monkeypatch.setattr("lfobench.cells.plan.code_of", lambda method: {"file_of_mine.py": "0" * 64})
    outcome = lfobench_command("run", "--methods", mine, *ON_POLE, "--seeds", "0", "--out", tmp_path / "runs")
    assert outcome.code == 1
    assert "file_of_mine.py" in outcome.err and "changed after the plan was made" in outcome.err


def test_a_policy_is_used_with_the_code_that_it_was_trained_with(
    mine: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    out = tmp_path / "runs"
    run = ("run", "--methods", mine, *ON_POLE, "--seeds", "0", "--workers", "1", "--out", out)
    assert lfobench_command(*run).code == 0
    (record,) = records_in(out)
    assert load_policy(RecordFolder(out), record).act(np.zeros((2, 4), np.float32)).shape == (2, 1)
    assert lfobench_command("table", "--out", out, "--methods", mine).code == 0
    forget_registrations()
    with pytest.raises(UserError, match=r"Unknown method 'mine'.*the file's path"):
        load_policy(RecordFolder(out), record)
    (mine.parent / "rates.py").write_text("RATE = 0.2\n", encoding="utf-8")
    assert lfobench_command("table", "--out", out, "--methods", mine).code == 0
    with pytest.raises(UserError, match=f"Method 'mine' was edited after it was trained on {POLE_TASK}"):
        load_policy(RecordFolder(out), record)


def test_show_of_a_method_by_path(mine: Path, lfobench_command: InProcess) -> None:
    shown = lfobench_command("show", mine)
    assert shown.code == 0
    assert "mine (version 1)" in shown.out and "beta" in shown.out


# --- lfobench new --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["my-first", "none", "2nd"])
def test_a_new_method_trains_at_once(
    name: str, tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert lfobench_command("new", "method", name).code == 0
    assert [path.name for path in tmp_path.iterdir()] == [f"{name}.py"]
    assert lfobench_command("check", f"{name}.py").code == 0
    run = ("run", "--methods", f"{name}.py", *ON_POLE, "--seeds", "0-1", "--workers", "1", "--out", "runs")
    outcome = lfobench_command(*run)
    assert outcome.code == 0, outcome
    assert [(record.method, record.status) for record in records_in(tmp_path / "runs")] == [(name, "finished")] * 2
    text = (tmp_path / f"{name}.py").read_text(encoding="utf-8")
    assert_refused(lfobench_command("new", "method", name), f"{name}.py is there already")
    assert (tmp_path / f"{name}.py").read_text(encoding="utf-8") == text
    assert not re.search(r"\b(mine|Mine|MineConfig)\b", text)


def test_a_new_method_is_short() -> None:
    source = (Path(lfobench.__file__).parent / "templates" / "method.py").read_text(encoding="utf-8")
    body = source[source.index("class MineConfig") :].splitlines()
    assert sum(bool(line.strip()) and not line.strip().startswith(('"""', "#")) for line in body) <= 25


def test_a_new_suite_runs_at_once(tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert lfobench_command("new", "suite", "balance").code == 0
    run = ("run", "--suite", "balance.py", "--methods", "bc-expert,dilo", "--protocol", "smoke", "--seeds", "0")
    outcome = lfobench_command(*run, "--workers", "1")
    assert outcome.code == 0, outcome
    found = records_in(tmp_path / "runs")
    assert {(record.labels.suite, record.task) for record in found} == {("balance", "pole-random-expert")}
    assert all(95.0 < record.provenance["demonstration_score"] <= 101.0 for record in found)


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("method", "bc", ("There is a method 'bc'",)),
        ("suite", "locomotion", ("There is a suite 'locomotion'",)),
        ("method", "a/b", ("'a/b' is no name",)),
        ("method", "a.b", ("'a.b' is no name",)),
        ("method", "torch", ("torch.py would hide the package 'torch'",)),
        ("suite", "json", ("json.py would hide the package 'json'",)),
    ],
)
def test_names_that_a_new_file_cannot_have(
    kind: str, name: str, words: tuple[str, ...], tmp_path: Path, lfobench_command: InProcess, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused(lfobench_command("new", kind, name), *words)
    assert list(tmp_path.iterdir()) == []
