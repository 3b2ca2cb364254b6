"""Calling the command line: in this process, which is fast, or as a process of its own, which is the real thing."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

import lfobench.cli

PATIENCE = 900.0
"""Seconds after which something hangs, however busy the machine is; nothing that works waits for their end."""


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    code: int
    out: str
    err: str


class InProcess:
    """``main()`` with the given arguments; anything but an exit is a traceback to the user and fails the test."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
        main: Callable[[], None] = lfobench.cli.main,
    ) -> None:
        self._main = main
        self._monkeypatch = monkeypatch
        self._capsys = capsys

    def __call__(self, *arguments: object) -> Outcome:
        self._monkeypatch.setattr(sys, "argv", ["lfobench", *map(str, arguments)])
        self._capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            self._main()
        captured = self._capsys.readouterr()
        code = ended.value.code
        return Outcome(code if isinstance(code, int) else int(code is not None), captured.out, captured.err)


def arguments(*command: object) -> list[str]:
    """A command line of a process of its own."""
    return [sys.executable, "-m", "lfobench", *map(str, command)]


def environment(changes: Mapping[str, str] | None = None) -> dict[str, str]:
    """This process's environment with changes."""
    return {**os.environ, **(changes or {})}


def process(command: Sequence[str], *, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Outcome:
    """Run a command to its end."""
    done = subprocess.run(
        list(command), cwd=cwd, env=environment(env), capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def assert_refused(outcome: Outcome, *words: str) -> None:
    """A user's mistake: exit code 2, one line on standard error that holds `words`, no traceback."""
    assert outcome.code == 2, outcome
    assert "Traceback" not in outcome.err
    lines = [line for line in outcome.err.splitlines() if line.strip()]
    assert len(lines) == 1, outcome.err
    assert lines[0].startswith("Error: ")
    for word in words:
        assert word in lines[0], (word, lines[0])
