"""`lfobench.run`: the same as the command line, for classes too."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers_cli import InProcess, environment
from helpers_engine import POLE_TASK, TINY, Drifting, Raising
from helpers_plugins import method_source, records_in

import lfobench
from lfobench.contract.method import Metrics
from lfobench.errors import UserError


@pytest.fixture(autouse=True)
def hasty_probe(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a plan takes is not asked here."""
    monkeypatch.setattr("lfobench.engine.probe.PROBE_SECONDS", 1e-9)


ON_POLE = ("--suite", TINY, "--tasks", POLE_TASK, "--protocol", "smoke", "--seeds", "0-1")
ON_POLE_FROM_PYTHON: dict[str, Any] = {"suite": TINY, "tasks": POLE_TASK, "protocol": "smoke", "seeds": [0, 1]}


def test_run_from_python_trains_and_returns_the_records(tmp_path: Path, lfobench_command: InProcess) -> None:
    lines: list[str] = []
    found = lfobench.run(
        [Drifting, "bc"], **ON_POLE_FROM_PYTHON, workers=1, out=tmp_path / "runs", progress=lines.append
    )
    assert [(record.method, record.seed) for record in found.records] == [
        (method, seed) for method in ("drifting", "bc") for seed in (0, 1)
    ]
    assert found.methods == ["drifting", "bc"] and found.tasks == [POLE_TASK]
    assert len(lines) == 4 and "drifting:released pole-random-expert seed 0: score" in lines[0]
    assert records_in(tmp_path / "runs") == sorted(found.records, key=lambda record: (record.method, record.seed))
    again = lfobench.run(["bc"], **ON_POLE_FROM_PYTHON, out=tmp_path / "runs", progress=lines.append)
    assert len(again.records) == 2 and len(lines) == 4, "what is done is not redone"
    command = (
        "why",
        "--methods",
        "bc",
        "--suite",
        TINY,
        "--tasks",
        POLE_TASK,
        "--protocol",
        "smoke",
        "--seeds",
        "0-1",
        "--out",
        tmp_path / "runs",
        "--json",
    )
    assert all(each["reused"] for each in json.loads(lfobench_command(*command).out))
    changed = lfobench.run("bc", **ON_POLE_FROM_PYTHON, set={"bc.loss": "squared"}, workers=1, out=tmp_path / "runs")
    assert [record.identity["set"] for record in changed.records] == [{"loss": "squared"}] * 2


def test_mistakes_from_python_are_user_errors(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="Unknown method 'dillo'"):
        lfobench.run("dillo", out=tmp_path)
    with pytest.raises(UserError, match="is not a lfobench Method class"):
        lfobench.run([int], out=tmp_path)  # type: ignore[list-item]
    with pytest.raises(UserError, match=r"Method 'raising' breaks the rule.*a bug in somebody's method"):
        lfobench.run(Raising, **ON_POLE_FROM_PYTHON, workers=1, out=tmp_path)


def test_runs_that_crash_are_warned_of_and_an_error_where_nothing_else_is_left(tmp_path: Path) -> None:
    class Late(Drifting):
        name = "late"

        def update(self, *arguments: Any) -> Metrics:
            if self.drifts >= 35:
                raise RuntimeError("too late")
            return super().update(*arguments)

    with (
        pytest.warns(UserWarning, match="No other process can import the class of late"),
        pytest.raises(UserError, match=r"None of the runs has left a record.*late:released.*RuntimeError: too late"),
    ):
        lfobench.run(Late, **ON_POLE_FROM_PYTHON, out=tmp_path)
    with pytest.warns(UserWarning, match=r"RuntimeError: too late.*The same call tries again"):
        left = lfobench.run([Late, "bc"], **ON_POLE_FROM_PYTHON, out=tmp_path)
    assert [record.method for record in left.records] == ["bc", "bc"]
    assert {(failure.method, failure.seed) for failure in left.failures} == {("late", 0), ("late", 1)}


def script(tmp_path: Path, shared_cache: Path, source: str, *, typed: bool = False) -> subprocess.CompletedProcess[str]:
    """A script of a user's, or the same typed into an interactive session."""
    call = f"""
from pathlib import Path
import lfobench
def main():
    found = lfobench.run([Mine, "bc"], suite={TINY!r}, tasks="pole-*", protocol="smoke", seeds=[0], out="runs")
    print(sorted((record.method, record.task) for record in found.records))
    print(found.records[0].identity["method_code"].keys())
"""
    path = tmp_path / "script.py"
    path.write_text(f"{source}\n{call}\nif __name__ == '__main__':\n    main()\n", encoding="utf-8")
    return subprocess.run(
        [sys.executable, "-c", "exec(open('script.py').read())"] if typed else [sys.executable, str(path)],
        cwd=tmp_path,
        env=environment({"LFOBENCH_CACHE": str(shared_cache)}),
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.mark.slow
@pytest.mark.parametrize("typed", [False, True], ids=["script", "session"])
def test_a_class_of_the_main_program_runs_in_it(typed: bool, tmp_path: Path, shared_cache: Path) -> None:
    done = script(tmp_path, shared_cache, method_source(), typed=typed)
    assert done.returncode == 0, done.stderr
    assert "('mine', 'pole-medium-expert'), ('mine', 'pole-random-expert')" in done.stdout
    assert ("<session>" if typed else "script.py") in done.stdout
    assert "No other process can import the class of mine" in done.stderr


@pytest.mark.slow
def test_a_class_that_can_be_imported_runs_in_worker_processes(tmp_path: Path, shared_cache: Path) -> None:
    (tmp_path / "of_mine.py").write_text(method_source(), encoding="utf-8")
    done = script(tmp_path, shared_cache, "from of_mine import Mine")
    assert done.returncode == 0, done.stderr
    assert "dict_keys(['of_mine.py'])" in done.stdout
    assert done.stderr == ""


@pytest.mark.slow
def test_a_script_without_its_guard_is_told_so(tmp_path: Path, shared_cache: Path) -> None:
    (tmp_path / "of_mine.py").write_text(method_source(), encoding="utf-8")
    source = f"from of_mine import Mine\nimport lfobench\nlfobench.run([Mine, 'bc'], suite={TINY!r}, protocol='smoke')"
    done = script(tmp_path, shared_cache, source)
    assert done.returncode != 0
    assert 'Put the call below: if __name__ == "__main__":' in done.stderr


@pytest.mark.slow
def test_ctrl_c_saves_and_the_same_call_continues(tmp_path: Path, shared_cache: Path) -> None:
    source = f"""
import lfobench
def main():
    try:
        found = lfobench.run("bc", suite={TINY!r}, tasks="pole-random-expert", protocol="smoke", steps=4000,
                             seeds=[0], workers=1, progress=print)
    except KeyboardInterrupt:
        print("stopped")
    else:
        print(len(found.records), "record")
if __name__ == "__main__":
    main()
"""
    (tmp_path / "script.py").write_text(source, encoding="utf-8")
    started = environment({"LFOBENCH_CACHE": str(shared_cache), "PYTHONUNBUFFERED": "1"})
    command = [sys.executable, "script.py"]
    with subprocess.Popen(command, cwd=tmp_path, env=started, stdout=subprocess.PIPE, text=True) as running:
        for _ in checkpoints(tmp_path / "runs"):
            assert running.poll() is None
        os.kill(running.pid, signal.SIGINT)
        out, _ = running.communicate(timeout=120)
    assert out.strip() == "stopped"
    done = subprocess.run(command, cwd=tmp_path, env=started, capture_output=True, text=True, timeout=300)
    assert done.stdout.strip().endswith("1 record"), done


def checkpoints(out: Path) -> Iterator[None]:
    """Until training has begun."""
    while not list(out.glob("checkpoints/*")):
        yield
        time.sleep(0.01)
