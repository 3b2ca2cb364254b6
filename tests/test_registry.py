"""Methods and suites by name, by entry point and by path."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_cli import InProcess, assert_refused
from helpers_engine import TINY
from helpers_folders import write_records
from helpers_plugins import forget_registrations, install, method_source, use
from helpers_records import make_record

from lfobench.contract.method import Method
from lfobench.contract.suite import Suite
from lfobench.errors import UserError
from lfobench.registry import load_method, load_suite, method_names, suite_names
from lfobench.source_code import code_of, in_session


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
        ("import sys; sys.exit('no licence')", "cannot be run: SystemExit: no licence"),
    ],
)
def test_suite_files_that_are_none(tmp_path: Path, source: str, message: str) -> None:
    path = tmp_path / "suite.py"
    path.write_text(source, encoding="utf-8")
    with pytest.raises(UserError, match=message) as refused:
        load_suite(str(path))
    assert str(path) in str(refused.value)


# --- broken plug-ins ------------------------------------------------------------------------------------------------

BROKEN = {
    "unfinished": (
        method_source("unfinished", "Unfinished").replace("def act(", "def do("),
        ("'unfinished' (broken.unfinished:Unfinished)", "it lacks act"),
    ),
    "nameless": (
        method_source("nameless", "Nameless").replace('    name = "nameless"\n', ""),
        ("'nameless'", "it has no name"),
    ),
    "renamed": (method_source("other", "Renamed"), ("'renamed'", "it calls itself 'other'")),
    "misnamed": (method_source("a,b", "Misnamed"), ("'misnamed'", "its name is 'a,b'")),
    "configless": (
        method_source("configless", "Configless").replace("    Config = Config\n", ""),
        ("'configless'", "it has no Config"),
    ),
    "misconfigured": (
        method_source("misconfigured", "Misconfigured").replace("    Config = Config\n", "    Config = dict\n"),
        ("'misconfigured'", "its Config is not a MethodConfig"),
    ),
    "demanding": (
        method_source("demanding", "Demanding").replace("Field(1.0,", "Field("),
        ("'demanding'", "its preset 'released' does not fit its Config (beta: field required)"),
    ),
    **{
        kind: (method_source(kind, kind.title()) + f"\n    {declared}\n", (f"'{kind}'", words))
        for kind, declared, words in (
            ("presetless", 'presets = {"released": None}', "its presets are not a mapping of names"),
            ("listed", 'presets = ["released"]', "its presets are not a mapping of names"),
            ("budgeted", 'budgets = {"smoke": 3}', "its budgets are not a mapping of names"),
            ("clashing", 'budgets = {"smoke": {"beta": "much"}}', "its budget 'smoke' does not fit its Config (beta"),
            ("unstated", "stated = None", "its stated is not a tuple of names"),
            ("spelled", 'stated = "beta"', "its stated is not a tuple of names"),
            ("gridded", 'grids = {"beta": 0.1}', "its grids are not a mapping of fields"),
            ("texted", 'grids = {"beta": "0.1"}', "its grids are not a mapping of fields"),
            ("seeing", "access_to_expert_actions = None", "access_to_expert_actions is neither"),
        )
    },
    "raising": (
        method_source("raising", "Raising").replace(
            "\n\nclass Raising",
            "\n    def model_post_init(self, context):\n        raise TypeError('no beta')\n\n\nclass Raising",
        ),
        ("'raising'", "its preset 'released' does not fit its Config", "no beta"),
    ),
    "strange": ("Strange = 3", ("'strange'", "is not a lfobench Method class")),
    "absent": ("import no_such_module", ("'absent'", "ModuleNotFoundError", "no_such_module", "absent.py, line 1")),
    "leaving": ("raise SystemExit(3)", ("'leaving'", "SystemExit: 3", "leaving.py, line 1")),
    "misspelled": ("x = 1\ndef f(:\n", ("'misspelled'", "SyntaxError", "misspelled.py, line 2")),
    "interrupted": ("raise ValueError('no\\nway')", ("'interrupted'", "no", "way")),
}


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of methods and suites that are all broken, one that has a whole method, and one that takes its name."""
    site = install(
        tmp_path / "site",
        "broken",
        {
            **{name: source for name, (source, _) in BROKEN.items()},
            "poles": "SUITE = 3",
            "rods": "import no_such_module",
        },
        methods={name: f"broken.{name}:{name.title()}" for name in BROKEN},
        suites={"poles": "broken.poles:SUITE", "rods": "broken.rods:SUITE", "rods-too": "broken.rods:SUITE"},
    )
    for package in ("first", "second"):
        install(
            site,
            package,
            {"mine": method_source("whole" if package == "first" else "twice"), "twice": method_source("twice")},
            methods={"twice": f"{package}.twice:Mine"} | ({"whole": "first.mine:Mine"} if package == "first" else {}),
            suites={"doubled": f"{package}.poles:SUITE"},
        )
    use(site, monkeypatch)
    yield site
    monkeypatch.undo()
    forget_registrations()


@pytest.mark.parametrize("name", BROKEN)
def test_asking_for_a_broken_method_is_one_line(name: str, broken: Path, lfobench_command: InProcess) -> None:
    _, words = BROKEN[name]
    for command in (
        ("show", name),
        ("check", name),
        ("tune", "--methods", name, "--grid", f"{name}.beta=1,2"),
        ("run", "--methods", f"bc,{name}", "--dry-run", "--protocol", "smoke"),
    ):
        assert_refused(lfobench_command(*command), *words)


def test_a_name_that_two_packages_register_is_nobody_s(broken: Path, lfobench_command: InProcess) -> None:
    assert_refused(lfobench_command("show", "twice"), "'twice' is registered twice", "first.twice:Mine", "second.twice")
    assert load_method("whole").name == "whole"


def test_what_is_broken_is_named_and_disables_nothing_else(broken: Path, lfobench_command: InProcess) -> None:
    listed = lfobench_command("ls", "methods", "--json")
    assert listed.code == 0
    summaries = {row["name"]: row["summary"] for row in json.loads(listed.out)}
    assert {"dilo", "whole", "twice", *BROKEN} <= set(summaries)
    for name, (_, words) in BROKEN.items():
        assert all(word in summaries[name] for word in words)
    suites = {row["name"]: row for row in json.loads(lfobench_command("ls", "suites", "--json").out)}
    assert "is not a lfobench Suite" in suites["poles"]["summary"]
    assert suites["locomotion"]["tasks"] == 16
    assert lfobench_command("show", "whole").code == 0


def test_broken_suites_are_warned_of_where_all_are_looked_through(broken: Path, lfobench_command: InProcess) -> None:
    shown = lfobench_command("show", "pen-human-expert")
    assert shown.code == 0
    warnings = [line for line in shown.err.splitlines() if line.startswith("Warning: ")]
    assert len(warnings) == len(shown.err.splitlines()) == 4
    assert [name for name in ("'doubled'", "'poles'", "'rods'", "'rods-too'") for line in warnings if name in line] == [
        "'doubled'",
        "'poles'",
        "'rods'",
        "'rods-too'",
    ]
    for name in ("doubled", "poles", "rods"):
        assert_refused(lfobench_command("ls", "tasks", "--suite", name), f"'{name}'")
    plan = ("run", "--methods", "bc", "--suite", TINY, "--tasks", "pole-random-expert", "--protocol", "smoke")
    assert lfobench_command(*plan, "--dry-run").code == 0
    assert_refused(lfobench_command(*plan[:-4], "--tasks", "pen-human-expert", "--dry-run"), "--suite adroit")


def test_a_table_of_records_of_a_broken_suite_is_made(
    broken: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    record = make_record(50.0)
    record = record.model_copy(update={"labels": record.labels.model_copy(update={"suite": "rods"})})
    folder = write_records(tmp_path / "runs", [record])
    outcome = lfobench_command("table", "--out", folder, "--format", "csv")
    assert outcome.code == 0
    assert record.task in outcome.out
    assert outcome.err.count("Warning: ") == 1 and "'rods' (broken.rods:SUITE)" in outcome.err


# --- methods where they stand ---------------------------------------------------------------------------------------


def test_a_method_by_path(tmp_path: Path) -> None:
    path = tmp_path / "some.py"
    path.write_text(
        method_source().replace("import torch\n", "import torch\nfrom nets import HALF\n"), encoding="utf-8"
    )
    (tmp_path / "nets.py").write_text("HALF = 0.5", encoding="utf-8")
    method = load_method(str(path))
    assert (method.name, method.__name__) == ("mine", "Mine")
    assert load_method(str(path)) is load_method(f"{path}:Mine") is load_method("mine") is method
    assert not in_session(method)


def test_an_edited_file_is_another_method(tmp_path: Path) -> None:
    path = tmp_path / "edited.py"
    path.write_text(method_source(), encoding="utf-8")
    before = load_method(str(path))
    path.write_text(method_source().replace("0.1 *", "0.2 *"), encoding="utf-8")
    after = load_method(str(path))
    assert after is not before
    assert code_of(after) != code_of(before)
    assert set(code_of(after)) == {"edited.py"}


def test_a_method_in_a_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "package_of_mine").mkdir()
    (tmp_path / "package_of_mine" / "deep.py").write_text(method_source(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    method = load_method("package_of_mine.deep:Mine")
    assert (method.name, method.__module__) == ("mine", "package_of_mine.deep")
    assert not in_session(method)


@pytest.mark.parametrize(
    ("source", "place", "words"),
    [
        ("x = 1", "", ("defines no Method",)),
        (method_source("a", "A") + method_source("b", "B"), "", ("defines A, B", "some.py:A")),
        (method_source(), ":Other", ("no class 'Other'",)),
        (method_source(), ":Config", ("is not a lfobench Method class",)),
        (method_source().replace("def act(", "def do("), "", ("some.py cannot be used", "it lacks act")),
        (method_source("bc"), "", ("has the name 'bc'", "registered")),
        ("def f(:", "", ("SyntaxError", "some.py, line 1")),
        ("def f():\n    undefined\nf()", "", ("NameError", "some.py, line 2")),
        ("raise SystemExit", "", ("SystemExit",)),
    ],
)
def test_files_that_are_no_method(
    source: str, place: str, words: tuple[str, ...], tmp_path: Path, lfobench_command: InProcess
) -> None:
    path = tmp_path / "some.py"
    path.write_text(source, encoding="utf-8")
    for command in (("show", f"{path}{place}"), ("run", "--methods", f"{path}{place}", "--dry-run")):
        assert_refused(lfobench_command(*command), *words)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("absent.py", ("No method file at absent.py",)),
        ("no_such_module:Mine", ("no_such_module:Mine cannot be imported", "ModuleNotFoundError")),
        ("json:Mine", ("no class 'Mine' in json:Mine",)),
        ("json:loads", ("json:loads is not a lfobench Method class",)),
        ("dillo", ("Unknown method 'dillo'", "Did you mean 'dilo'")),
    ],
)
def test_places_where_no_method_stands(name: str, words: tuple[str, ...], lfobench_command: InProcess) -> None:
    assert_refused(lfobench_command("run", "--methods", name, "--dry-run"), *words)


def test_two_methods_of_one_name_do_not_run_together(tmp_path: Path, lfobench_command: InProcess) -> None:
    for name in ("one", "two"):
        (tmp_path / f"{name}.py").write_text(method_source(class_name=name.title()), encoding="utf-8")
    both = f"{tmp_path / 'one.py'},{tmp_path / 'two.py'}"
    assert_refused(lfobench_command("run", "--methods", both, "--dry-run"), "one.py", "two.py", "both named 'mine'")
