"""Files of a method from outside: whoever edits one has another method."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from textwrap import dedent

import pytest
from helpers_engine import Drifting, smoke_cell
from helpers_plugins import forget_registrations, install, method_source, use

from lfobench.cells.cell import Run
from lfobench.cells.plan import Request, make_plan
from lfobench.errors import UserError
from lfobench.python_files import forget
from lfobench.registry import load_method, method_names, package_of
from lfobench.source_code import SESSION, check_unchanged, code_of, in_session, ships

TINY = str(Path(__file__).with_name("tiny_suite.py"))


def write(folder: Path, files: Mapping[str, str]) -> None:
    for name, source in files.items():
        place = folder / f"{name}.py"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(dedent(source), encoding="utf-8")


def hash_of(path: Path) -> str:
    (run, *_) = make_plan(Request(str(path), TINY, "pole-random-expert", protocol="smoke"), lambda: False).runs
    return run.identity_hash


def test_methods_that_ship_have_a_version_and_no_files() -> None:
    for name in method_names():
        method = load_method(name)
        assert ships(method) and code_of(method) == {} and package_of(method) == {}
        assert "method_code" not in smoke_cell(name).identity
    assert not ships(Drifting)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A method, what it imports in many ways, and what it does not."""
    source = """
        import json
        import numpy
        import nets
        from inner.deep import WIDTH
        from methods import bc

        def later():
            from inner import shallow
    """
    files = {
        "mine": method_source() + dedent(source),
        "nets": "import losses",
        "losses": "",
        "inner/__init__": "",
        "inner/deep": "from . import beside\nfrom .beside import y\nWIDTH = 3",
        "inner/beside": "from .. import losses\ny = 1",
        "inner/shallow": "",
    }
    write(tmp_path, files | dict.fromkeys(("inner/unused", "stranger", "json", "methods/bc"), ""))
    return tmp_path


FILES = {"mine.py", "nets.py", "losses.py", "inner/__init__.py", "inner/deep.py", "inner/beside.py", "inner/shallow.py"}


def test_everything_that_is_imported_from_its_folder_counts(folder: Path) -> None:
    assert set(code_of(load_method(str(folder / "mine.py")))) == FILES


@pytest.mark.parametrize("file", sorted(FILES))
def test_an_edit_of_any_of_them_is_another_run(file: str, folder: Path) -> None:
    before = hash_of(folder / "mine.py")
    with (folder / file).open("a", encoding="utf-8") as out:
        out.write("\n# a remark\n")
    assert hash_of(folder / "mine.py") != before


def test_a_folder_named_as_ours_counts_but_for_what_ours_has(tmp_path: Path) -> None:
    later = "\ndef later():\n    from methods import bc, losses\n"
    write(tmp_path, {"mine": method_source() + later, "methods/__init__": "", "methods/bc": "", "methods/losses": ""})
    assert set(code_of(load_method(str(tmp_path / "mine.py")))) == {"mine.py", "methods/losses.py"}


def test_an_edit_of_anything_else_is_not(folder: Path) -> None:
    before = hash_of(folder / "mine.py")
    for file in ("inner/unused.py", "stranger.py", "json.py"):
        (folder / file).write_text("x = 1", encoding="utf-8")
    forget(folder / "mine.py")
    assert hash_of(folder / "mine.py") == before


def test_the_packages_that_a_module_lies_in_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, {"outer_of_mine/__init__": "", "outer_of_mine/inner/__init__": "import outer_of_mine.parts"})
    write(tmp_path, {"outer_of_mine/inner/mine": method_source(), "outer_of_mine/parts": ""})
    monkeypatch.chdir(tmp_path)
    files = set(code_of(load_method("outer_of_mine.inner.mine:Mine")))
    assert files == {f"outer_of_mine/{name}.py" for name in ("__init__", "inner/__init__", "inner/mine", "parts")}


def test_where_the_folder_lies_and_when_it_was_written_do_not_matter(folder: Path, tmp_path: Path) -> None:
    elsewhere = folder.rename(tmp_path.parent / f"{tmp_path.name}-elsewhere")
    moved = hash_of(elsewhere / "mine.py")
    (elsewhere / "nets.py").touch()
    assert hash_of(elsewhere.rename(folder) / "mine.py") == moved


def test_the_identity_is_the_same_in_another_process(folder: Path) -> None:
    source = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\nfrom test_source_code import hash_of\n"
    source += f"from pathlib import Path; print(hash_of(Path({str(folder / 'mine.py')!r})))"
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == hash_of(folder / "mine.py")


def test_of_an_installed_package_its_own_modules_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = install(
        tmp_path / "site-packages",
        "somebody",
        {"mine": method_source() + "from somebody import nets\nimport neighbour\nfrom . import parts\n"}
        | {"nets": "", "parts": "", "others": ""},
        methods={"mine": "somebody.mine:Mine"},
    )
    install(site, "neighbour", {})
    use(site, monkeypatch)
    try:
        method = load_method("mine")
        assert set(code_of(method)) == {
            "somebody/__init__.py",
            "somebody/mine.py",
            "somebody/nets.py",
            "somebody/parts.py",
        }
        assert package_of(method) == {"somebody": "1.0"}
    finally:
        monkeypatch.undo()
        forget_registrations()


def test_a_class_whose_file_was_edited_after_its_import_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "stale.py"
    path.write_text(method_source(), encoding="utf-8")
    module = __import__("runpy").run_path(str(path), run_name="stale_module")
    sys.modules["stale_module"] = type(sys)("stale_module")
    sys.modules["stale_module"].__dict__.update(module)
    try:
        path.write_text(method_source().replace("0.1 *", "0.2 *"), encoding="utf-8")
        with pytest.raises(UserError, match=r"stale\.py was edited after its method 'mine' was imported"):
            code_of(module["Mine"])
    finally:
        del sys.modules["stale_module"]


def test_code_that_an_import_hook_rewrites_is_not_an_edit(tmp_path: Path) -> None:
    """As under pytest, which compiles other assertions than those in the file."""
    source = method_source() + "\n    def check(self):\n        assert self.mean is not None\n"
    (tmp_path / "test_rewritten.py").write_text(
        f"from lfobench.source_code import code_of\n{source}\n\ndef test_it():\n    print(set(code_of(Mine)))\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", "test_rewritten.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert "{'test_rewritten.py'}" in done.stdout


def test_nothing_trains_as_what_was_planned_once_its_files_are_others(folder: Path) -> None:
    method = load_method(str(folder / "mine.py"))
    check_unchanged(method, code_of(method))
    with pytest.raises(UserError, match=r"nets\.py of method 'mine' changed after the plan was made"):
        check_unchanged(method, {**code_of(method), "nets.py": "0" * 64})


# --- classes that were typed into a session --------------------------------------------------------------------------


def typed(source: str, folder: Path | None = None, refused: bool = False) -> dict[str, str]:
    """Code of a method as a notebook has it, of the main program, in no file; or the message that refuses it."""
    code = f"""
import sys
from lfobench.source_code import code_of, in_session
exec(compile({source!r}, "<cell>", "exec"), sys.modules["__main__"].__dict__)
assert in_session(Mine)
print(code_of(Mine))
"""
    path = os.pathsep.join([str(folder), *sys.path])
    done = subprocess.run(
        [sys.executable, "-"], input=code, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    if refused:
        return {"UserError": done.stderr.splitlines()[-1]}
    assert done.returncode == 0, done.stderr
    return eval(done.stdout)  # type: ignore[no-any-return]


HELPED = method_source().replace("0.1 *", "RATE * scale(Half) *") + dedent("""
    RATE = 0.1
    class Half:
        value = 0.5
    def scale(kind):
        return kind.value
""")


@pytest.mark.slow
@pytest.mark.parametrize(
    "edit",
    [
        lambda source: source.replace("RATE = 0.1", "RATE = 0.2"),
        lambda source: source.replace("value = 0.5", "value = 0.25"),
        lambda source: source.replace("return kind.value", "return kind.value + 1"),
        lambda source: source.replace("Field(1.0", "Field(2.0"),
        lambda source: source.replace(".clamp(-1.0, 1.0)", ".clamp(-1.0, 0.5)"),
        lambda source: source.replace("beta: float", "gamma: int = 3\n    beta: float"),
    ],
)
def test_of_a_class_in_no_file_what_was_typed_counts(edit: Callable[[str], str]) -> None:
    before = typed(HELPED)
    assert set(before) == {SESSION}
    assert typed(HELPED) == before
    assert edit(HELPED) != HELPED
    assert typed(edit(HELPED)) != before


USING = method_source().replace(
    "0.1 *", "0.1 * loss(helper, other, TABLE, LAYERS, NAMES, Row, half, start()) *"
) + dedent("""
    import helper
    from dataclasses import dataclass, field
    from functools import partial
    from helper import loss
    from helper import loss as other
    TABLE = {"a": [1, {"b": 2}]}
    LAYERS = [1, (2, 3)]
    NAMES = {"one", "two", "three"}
    half = partial(max, 0.5)
    @dataclass
    class Row:
        width: int = 3
        parts: list = field(default_factory=list)
    @torch.no_grad()
    def start(scale=[1], using=loss):
        from helper import loss
        return scale
""")


@pytest.mark.slow
def test_values_and_decorated_functions_of_the_session_count(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text("def loss(*_): return 1.0", encoding="utf-8")
    edits = {
        '{"b": 2}': '{"b": 3}',
        "LAYERS = [1, (2, 3)]": "LAYERS = [1, (3, 2)]",
        '"three"}': '"four"}',
        "partial(max, 0.5)": "partial(max, 0.6)",
        "width: int = 3": "width: int = 4",
        "scale=[1]": "scale=[2]",
        "return scale": "return scale * 2",
    }
    assert all(old in USING for old in edits)
    sources = [USING, USING, *(USING.replace(old, new) for old, new in edits.items())]
    code = f"""
from lfobench.source_code import code_of
for source in {sources!r}:
    variables = {{"__name__": "__main__"}}
    exec(compile(source, "<cell>", "exec"), variables)
    print(code_of(variables["Mine"]))
"""
    path = os.pathsep.join([str(tmp_path), *sys.path])
    lines = [
        subprocess.run(
            [sys.executable, "-"], input=code, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
        ).stdout.splitlines()
        for _ in range(2)
    ]
    assert lines[0] == lines[1]
    assert len(lines[0]) == len(sources)
    assert lines[0][0] == lines[0][1]
    assert len(set(lines[0])) == 1 + len(edits)


@pytest.mark.slow
@pytest.mark.parametrize(
    "used",
    ["from helper import loss", "import helper as loss", "from helper import RATE, loss", "from helper import *"],
)
def test_files_that_a_session_imports_from_count(used: str, tmp_path: Path) -> None:
    source = method_source().replace("0.1 *", "loss and 0.1 *") + f"\n{used}\n"
    files = {
        "helper": "import deeper\nRATE = 1\ndef loss(x): return deeper.loss(x)\n",
        "deeper": "def loss(x): return x\n",
    }
    write(tmp_path, files)
    before = typed(source, tmp_path)
    (tmp_path / "unused.py").touch()
    assert typed(source, tmp_path) == before
    for name, text in files.items():
        write(tmp_path, files | {name: text.replace("return ", "return 2 * ")})
        assert typed(source, tmp_path) != before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("used", "call"), [("from methods.helper import loss", "loss"), ("import methods.helper", "methods.helper.loss")]
)
def test_files_that_a_session_imports_from_a_folder_named_as_ours_count(used: str, call: str, tmp_path: Path) -> None:
    source = method_source().replace("0.1 *", f"{call} and 0.1 *") + f"\n{used}\n"
    write(tmp_path, {"methods/helper": "def loss(x): return x\n"})
    before = typed(source, tmp_path)
    write(tmp_path, {"methods/bc": "raise AssertionError('not this one')"})
    assert typed(source, tmp_path) == before
    write(tmp_path, {"methods/helper": "def loss(x): return 2 * x\n"})
    assert typed(source, tmp_path) != before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "kind"), [("object()", "object"), ("torch.zeros(3)", "Tensor"), ("[torch.nn.Linear(1, 1)]", "Linear")]
)
def test_a_value_whose_changes_cannot_be_noticed_is_refused(made: str, kind: str) -> None:
    used = method_source().replace("0.1 *", "(THING, 0.1)[1] *") + f"\nTHING = {made}\n"
    default = method_source().replace("def act(self, observation", f"def act(self, observation, thing={made}")
    for source, name in ((used, "'THING'"), (default, "'Mine.act'")):
        message = typed(source, refused=True)["UserError"]
        assert all(word in message for word in ("UserError", name, kind, "Put the class into a file"))


def test_a_class_made_inside_a_function_is_of_this_session() -> None:
    class Local(Drifting):
        name = "local"

    assert in_session(Local)
    assert not in_session(Drifting)
    assert not in_session(load_method("bc"))
    cell = replace(smoke_cell("bc"), method=Drifting, config=Drifting.Config(), code=code_of(Drifting))
    assert set(Run(cell, 0).identity["method_code"]) >= {"helpers_engine.py"}
