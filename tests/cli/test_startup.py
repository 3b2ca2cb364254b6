"""Commands that only read do not load torch, which takes longer than all that they do."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = str(ROOT / "results" / "reference" / "locomotion-quick")
HOPPER = ["--suite", "locomotion", "--tasks", "hopper-random-expert"]

PROGRAM = """
import sys
import lfobench.cli
from lfobench import lazy_torch
try:
    lfobench.cli.main()
except SystemExit as ended:
    assert not ended.code, ended.code
assert not lazy_torch.is_loaded()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["ls", "methods"],
        ["ls", "suites"],
        ["show", "dilo"],
        ["show", "hopper-random-expert"],
        ["status", "--out", REFERENCE],
        ["table", "--out", REFERENCE],
        ["audit", "dilo-2024"],
        ["data", "ls"],
        ["why", "--methods", "dilo,bc", *HOPPER, "--device", "cpu", "--out", REFERENCE],
    ],
    ids=lambda arguments: " ".join(arguments[:2]),
)
def test_reading_loads_no_torch(arguments: list[str]) -> None:
    command = [sys.executable, "-c", PROGRAM, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_stand_in_becomes_torch_when_it_is_used() -> None:
    program = """
import sys
from lfobench import lazy_torch
lazy_torch.install()
import torch
import methods.dilo
import importlib.util
assert importlib.util.find_spec("torch") is not None
assert not lazy_torch.is_loaded()
import torch.nn.functional as functional
from torch import nn
assert lazy_torch.is_loaded()
assert functional is nn.functional is sys.modules["torch.nn.functional"]
assert isinstance(nn.Linear(1, 1).weight, torch.Tensor) and torch is not sys.modules["torch"]
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
