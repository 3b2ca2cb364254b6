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
@pytest.mark.parametrize("first", ["import lfobench", "from methods import REGISTRY"])
def test_the_start_of_a_users_package_runs_once_when_its_names_are_asked_for(first: str, tmp_path: Path) -> None:
    (tmp_path / "methods").mkdir()
    source = "from methods.mine import WHERE\nREGISTRY = [WHERE]\nDEMO = 'mine'\nprint('started')\n"
    (tmp_path / "methods" / "__init__.py").write_text(source, encoding="utf-8")
    (tmp_path / "methods" / "mine.py").write_text("WHERE = 'mine'", encoding="utf-8")
    script = tmp_path / "script.py"
    script.write_text(
        f"""
{first}
import lfobench
from lfobench.registry import load_method
from methods import REGISTRY, mine
import methods
assert REGISTRY == [mine.WHERE] == methods.REGISTRY and methods.DEMO != "mine" and not hasattr(methods, "nothing")
assert load_method("dilo").__module__ == "methods.dilo"
""",
        encoding="utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "started\n"), done.stderr


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


@pytest.mark.slow
def test_a_command_finds_ours_in_a_folder_with_such_folders(tmp_path: Path) -> None:
    for name in ("methods", "suites", "tools", "benchmarks"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise AssertionError('not this one')", encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for what in ("methods", "suites"):
        command = [sys.executable, "-m", "lfobench", "ls", what]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0 and "cannot be imported" not in done.stdout + done.stderr


@pytest.mark.slow
def test_a_file_that_took_the_name_of_one_of_ours_is_named(tmp_path: Path) -> None:
    (tmp_path / "methods").mkdir()
    (tmp_path / "methods" / "__init__.py").touch()
    taken = tmp_path / "methods" / "bc_expert.py"
    taken.write_text('from methods.bc import Bc\n\n\nclass Mine(Bc):\n    name = "mine"\n', encoding="utf-8")
    (tmp_path / "methods" / "bc.py").write_text((ROOT / "methods" / "bc.py").read_text("utf-8"), encoding="utf-8")
    program = """
from methods.bc_expert import Mine
from lfobench.errors import UserError
from lfobench.registry import give_method, load_method, load_suite
load_suite("locomotion")
for load in (lambda: load_method("bc"), lambda: give_method(Mine, "Mine")):
    try:
        load()
    except UserError as error:
        print(error.problem)
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [str(tmp_path / "methods") in line for line in done.stdout.splitlines()] == [True, True]


@pytest.mark.slow
def test_methods_imported_through_a_link_are_still_ours(tmp_path: Path) -> None:
    """Their files are named by the link if they are imported before lfobench."""
    (tmp_path / "link").symlink_to(ROOT, target_is_directory=True)
    program = "from methods.dilo import Dilo\nfrom lfobench.source_code import code_of\nassert code_of(Dilo) == {}"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "link")}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
