"""Methods and suites by name, by entry point and by path (decision 9)."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers_engine import TINY

from lfobench.contract.method import Method
from lfobench.contract.suite import Suite
from lfobench.errors import UserError
from lfobench.registry import load_method, load_suite, method_names, suite_names


def test_the_built_in_ones_are_registered() -> None:
    assert {"dilo", "smodice", "oril", "bco", "bc", "bc-expert"} <= set(method_names())
    assert "locomotion" in suite_names()
    for name in method_names():
        assert load_method(name).name == name
        assert issubclass(load_method(name), Method)
    for name in suite_names():
        assert load_suite(name).name == name


def test_a_suite_by_path() -> None:
    suite = load_suite(TINY)
    assert isinstance(suite, Suite)
    assert [task.name for task in suite.tasks] == ["pole-random-expert", "pole-medium-expert"]


def test_a_suite_file_may_hold_whatever_a_module_may(tmp_path: Path) -> None:
    """A demonstrator written as a dataclass needs its module to be known to Python."""
    path = tmp_path / "by_dataclass.py"
    source = (
        Path(TINY).read_text(encoding="utf-8").replace("import numpy as np", "import numpy as np\nimport dataclasses")
    )
    source = source.replace(
        "class Pole:", "@dataclasses.dataclass(frozen=True)\nclass Pole:\n    level: Level\n    scale: int = 1\n"
    )
    start, end = source.index("    def __init__"), source.index("    @property")
    path.write_text(source[:start] + source[end:], encoding="utf-8")
    assert len(load_suite(str(path)).tasks) == 2


def changed(old: str, new: str) -> str:
    source = Path(TINY).read_text(encoding="utf-8")
    assert old in source
    return source.replace(old, new)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("x = 1", "defines no SUITE"),
        ("SUITE = 3", "defines no SUITE"),
        ("raise RuntimeError('broken')", "cannot be run: RuntimeError: broken"),
        ("def f(:", "cannot be run: SyntaxError"),
        (changed("(_task(", "(_task('random', 20), _task("), "two tasks named pole-random-expert"),
        (changed('(_task("random", 20), _task("medium", 10))', "()"), "suite 'tiny' has no task"),
        (changed("60, 5.0, 60.0", "60, 5.0, 5.0"), "environment 'pole' has two equal reference returns"),
        (changed("60, 5.0, 60.0", "0, 5.0, 60.0"), "environment 'pole' has horizon 0"),
        (changed("60, 5.0, 60.0", "60, 5.0, 60.0, {'f': print}"), "environment 'pole' has arguments that are not"),
        (changed("60, 5.0, 60.0", "60, float('nan'), 60.0"), "environment 'pole' has a reference return that is not"),
        (changed("paper_steps=100", "paper_steps=0"), "task 'pole-random-expert' has paper_steps 0"),
        (changed("3_000", "0"), "a recipe's offline_transitions is 0"),
        (changed("trajectories, 60", "trajectories, 0"), "a recipe's demonstration_rows is 0"),
        ("import no_such_module", "cannot be run: ModuleNotFoundError"),
    ],
)
def test_suite_files_that_are_none(tmp_path: Path, source: str, message: str) -> None:
    path = tmp_path / "suite.py"
    path.write_text(source, encoding="utf-8")
    with pytest.raises(UserError, match=message) as refused:
        load_suite(str(path))
    assert str(path) in str(refused.value)
