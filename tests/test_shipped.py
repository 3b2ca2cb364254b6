"""Folders of a user's that have the names of packages that ship."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

SCRIPT = """
{before}
import lfobench
from lfobench.registry import load_method, load_suite
import methods.mine, suites.mine
assert load_method("dilo").__module__ == "methods.dilo"
assert load_suite("locomotion").name == "locomotion"
assert methods.mine.WHERE == suites.mine.WHERE == "mine"
if __name__ == "__main__":
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        found = pool.submit(getattr, load_method("dilo"), "__module__").result()
        assert found == pool.submit(load_method, "dilo").result().__module__ == "methods.dilo"
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "regular"),
    [
        ("", True),
        ("", False),
        ("import methods, suites", True),
        ("import methods, suites", False),
        # Without lfobench, Python itself prefers an installed package to a mere folder.
        ("import methods.mine", True),
    ],
)
def test_both_are_found(before: str, regular: bool, tmp_path: Path) -> None:
    for name in ("methods", "suites"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.py").write_text("WHERE = 'mine'", encoding="utf-8")
        for other in ("dilo", "locomotion"):
            (tmp_path / name / f"{other}.py").write_text("raise AssertionError('not this one')", encoding="utf-8")
        if regular:
            (tmp_path / name / "__init__.py").touch()
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(before=before), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_method_of_the_current_folder_is_found_after_one_of_ours(tmp_path: Path) -> None:
    """A console command, like ``python -P``, does not search the current folder for imports before that."""
    (tmp_path / "methods").mkdir()
    (tmp_path / "methods" / "__init__.py").touch()
    source = 'from methods.dilo import Dilo\n\n\nclass Mine(Dilo):\n    """Mine."""\n\n    name = "mine"\n'
    (tmp_path / "methods" / "mine.py").write_text(source, encoding="utf-8")
    program = """
from lfobench.registry import load_method
dilo, mine = load_method("dilo"), load_method("methods.mine:Mine")
assert issubclass(mine, dilo)
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-P", "-c", program]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
