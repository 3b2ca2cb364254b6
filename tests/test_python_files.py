"""Python files given by path: their neighbours are theirs alone, in every process."""

from __future__ import annotations

import importlib
import pickle
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import gymnasium
import pytest

from lfobench.errors import UserError
from lfobench.python_files import forget, load_file


def folder_with(folder: Path, **files: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, source in files.items():
        place = folder / f"{name.replace('__', '/')}.py"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(dedent(source), encoding="utf-8")
    return folder


def test_neighbours_of_equal_names_are_not_mixed_up(tmp_path: Path) -> None:
    """Imported at once, inside a function later, by a neighbour, and from a package."""
    source = """
        import helper
        from inner.deep import WHERE as deep
        import inner.deep

        def later():
            import late
            return late.WHERE, late.helper.WHERE, inner.deep.WHERE
    """
    found = []
    for name in ("one", "two"):
        folder_with(
            tmp_path / name,
            mine=source,
            helper=f"WHERE = {name!r}",
            late=f"import helper\nWHERE = {name!r}",
            inner__deep=f"WHERE = {name!r}",
        )
        found.append(load_file(tmp_path / name / "mine.py", "suite"))
    for name, module in zip(("one", "two"), found, strict=True):
        assert module.helper.WHERE == module.deep == name
        assert module.later() == (name, name, name)
    assert "helper" not in sys.modules and "late" not in sys.modules


def test_a_file_is_run_once(tmp_path: Path) -> None:
    folder_with(tmp_path, mine="import other\nx = object()", other="import mine\n")
    first = load_file(tmp_path / "mine.py", "suite")
    assert load_file(tmp_path / "mine.py", "suite") is first
    assert first.other.mine is first


def test_a_neighbour_takes_no_other_package_s_place(tmp_path: Path) -> None:
    """Those that register something with lfobench, and the standard library's; an installed one only in this folder."""
    lure = "raise AssertionError('a lure')"
    folder_with(
        tmp_path,
        mine="""
            import json, numpy
            import suites.locomotion
            from methods.bc import Bc
            import lfobench.text
        """,
        methods=lure,
        suites__locomotion=lure,
        benchmarks=lure,
        lfobench=lure,
        json=lure,
        numpy__notes="",
        yaml="mine = True",
        asks="import yaml",
    )
    module = load_file(tmp_path / "mine.py", "suite")
    assert module.Bc.__module__ == "methods.bc"
    assert module.suites.locomotion.SUITE.name == "locomotion"
    assert module.numpy.zeros(2).shape == (2,)  # a folder without code is no module
    assert load_file(tmp_path / "asks.py", "suite").yaml.mine
    assert not hasattr(sys.modules.get("yaml"), "mine")


def test_relative_imports_and_odd_names(tmp_path: Path) -> None:
    folder = folder_with(tmp_path / "v1.2 %x", helper="WHERE = 1", late__deep="from ..helper import WHERE")
    (folder / "my.own-suite.py").write_text("from . import helper\nfrom .late.deep import WHERE", encoding="utf-8")
    module = load_file(folder / "my.own-suite.py", "suite")
    assert module.helper.WHERE == module.WHERE == 1


def test_libraries_find_neighbours_by_their_plain_names(tmp_path: Path) -> None:
    """As Gymnasium does; where two folders have the name, nobody guesses."""
    for name in ("one", "two"):
        folder_with(
            tmp_path / name,
            mine="",
            worlds_of_mine=f"""
                import gymnasium
                WHERE = {name!r}

                class Still(gymnasium.Env):
                    pass

                gymnasium.register("Still-v0", entry_point="worlds_of_mine:Still")
            """,
        )
    load_file(tmp_path / "one" / "mine.py", "suite")
    try:
        world = gymnasium.make("worlds_of_mine:Still-v0", disable_env_checker=True).unwrapped
        here = importlib.import_module("worlds_of_mine")
        assert here.WHERE == "one" and type(world) is here.Still
        assert load_file(tmp_path / "one" / "worlds_of_mine.py", "suite") is here
        load_file(tmp_path / "two" / "mine.py", "suite")
        with pytest.raises(ImportError, match=r"one and .*two"):
            importlib.import_module("worlds_of_mine")
    finally:
        gymnasium.registry.pop("Still-v0", None)
        # Only this test's: files of other tests stay loaded, whichever order they run in.
        for name in ("one", "two"):
            forget(tmp_path / name / "mine.py")
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("no_such_module_at_all")


def test_its_classes_reach_other_processes(tmp_path: Path) -> None:
    """A process that is given nothing but the pickle."""
    folder_with(
        tmp_path,
        mine="import shapes\nclass Mine:\n    def area(self):\n        return shapes.Square(3).area()",
        shapes="class Square:\n    def __init__(self, side): self.side = side\n    def area(self): return self.side**2",
    )
    module = load_file(tmp_path / "mine.py", "suite")
    source = "import lfobench.registry, pickle, sys; print(pickle.load(sys.stdin.buffer).area())"
    for sent in (module.Mine(), module.shapes.Square(3)):
        done = subprocess.run([sys.executable, "-c", source], input=pickle.dumps(sent), stdout=subprocess.PIPE)
        assert done.stdout.split() == [b"9"]


def test_an_edited_file_is_read_anew(tmp_path: Path) -> None:
    """Python's own cache goes by seconds and sizes."""
    for value in (1, 2):
        folder_with(tmp_path, mine="from other import x", other=f"x = {value}")
        forget(tmp_path / "mine.py")
        assert load_file(tmp_path / "mine.py", "suite").x == value
    assert not (tmp_path / "__pycache__").exists()


@pytest.mark.parametrize(
    ("source", "named"),
    [
        ("raise SystemExit('go away')", "SystemExit: go away"),
        ("import sys; sys.exit(0)", "SystemExit: 0"),
        ("import other", "SystemExit: from a neighbour"),
        ("from broken import x", "SyntaxError"),
        ("import absent_neighbour", "No module named 'absent_neighbour'"),
        ("from fine import nothing", "nothing"),
    ],
)
def test_files_that_cannot_be_run(tmp_path: Path, source: str, named: str) -> None:
    folder_with(tmp_path, mine=source, other="exit('from a neighbour')", broken="def (:", fine="")
    with pytest.raises(UserError, match=named) as refused:
        load_file(tmp_path / "mine.py", "method")
    assert f"method file {tmp_path / 'mine.py'}" in str(refused.value)


def test_files_that_are_not_there(tmp_path: Path) -> None:
    (tmp_path / "loop.py").symlink_to("loop.py")
    (tmp_path / "folder.py").mkdir()
    for name in ("absent.py", "loop.py", "folder.py", "x\0.py"):
        with pytest.raises(UserError, match="file"):
            load_file(tmp_path / name, "suite")
