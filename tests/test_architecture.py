"""The architecture: which package may import which. Read from the source, imports inside functions included."""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# In the order in which data flows; every package may import itself.
MAY_IMPORT: dict[str, set[str]] = {
    "lazy_torch": set(),
    "shipped": set(),
    "errors": set(),
    "text": set(),
    "processes": set(),
    "files": {"errors"},
    "tensor_files": {"errors", "files"},
    "randomness": set(),
    "contract": {"errors", "randomness"},
    "nn": {"contract", "randomness"},
    "python_files": {"errors"},
    "source_code": {"shipped", "contract", "errors", "python_files", "text"},
    "registry": {"shipped", "contract", "errors", "python_files", "record", "source_code"},
    "score": {"errors"},
    "record": {"errors", "score", "text"},
    "cells": {"contract", "errors", "record", "registry", "source_code", "text"},
    "data": {
        "record",
        "contract",
        "cells",
        "errors",
        "files",
        "processes",
        "registry",
        "randomness",
        "tensor_files",
        "text",
    },
    "records": {"record", "score", "contract", "cells", "errors", "files", "text"},
    "engine": {
        "contract",
        "cells",
        "data",
        "record",
        "records",
        "errors",
        "files",
        "processes",
        "randomness",
        "registry",
        "source_code",
        "text",
        "tensor_files",
    },
    "schedule": {
        "contract",
        "cells",
        "data",
        "engine",
        "record",
        "records",
        "errors",
        "files",
        "processes",
        "source_code",
    },
    "stats": {"record", "records", "score"},
    "templates": {"contract", "nn", "randomness"},
    "tables": {"contract", "record", "score", "records", "stats", "errors", "text"},
    "analyses": {"record", "score", "data", "records", "stats", "tables", "errors", "text"},
    "plots": {"analyses", "record", "score", "contract", "data", "records", "stats", "tables", "errors", "text"},
    "html_report": {"record", "score", "records", "stats", "tables", "plots", "errors", "text"},
    "selection": {"cells", "errors", "record", "records", "registry", "score", "stats", "tables"},
    "api": {
        "contract",
        "engine",
        "selection",
        "record",
        "score",
        "analyses",
        "cells",
        "errors",
        "files",
        "html_report",
        "plots",
        "records",
        "registry",
        "schedule",
        "stats",
        "tables",
        "text",
    },
}
MAY_IMPORT["suite_pictures"] = {
    "selection",
    "contract",
    "cells",
    "data",
    "engine",
    "errors",
    "files",
    "plots",
    "record",
    "registry",
    "tables",
}
# The command line is above everything.
MAY_IMPORT["cli"] = set(MAY_IMPORT)

METHODS_MAY_IMPORT = {"torch", "pydantic", "methods"}


def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imported(path: Path) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of everything that a file imports; `from a import b` gives ``a.b``."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative imports hide the package"
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)


def package_of(path: Path) -> str:
    parts = path.relative_to(ROOT / "lfobench").with_suffix("").parts
    return parts[0]


def place(path: Path, line: int, name: str) -> str:
    return f"{path.relative_to(ROOT)}:{line} imports {name}"


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_packages_import_only_those_below(package: str) -> None:
    violations = []
    for path in sources("lfobench"):
        if package_of(path) != package:
            continue
        for line, name in imported(path):
            head, *rest = name.split(".")
            if head != "lfobench" or not rest:
                continue
            known = rest[0] in MAY_IMPORT
            if known and rest[0] != package and rest[0] not in MAY_IMPORT[package]:
                violations.append(place(path, line, name))
    assert violations == []


def test_every_module_is_in_a_known_package() -> None:
    packages = {package_of(path) for path in sources("lfobench")}
    assert packages == set(MAY_IMPORT) | {"__init__", "__main__"}


def test_only_the_entry_point_imports_the_command_line() -> None:
    users = [
        place(path, line, name)
        for package in ("lfobench", "methods", "suites")
        for path in sources(package)
        for line, name in imported(path)
        if name.startswith("lfobench.cli") and top_package_of(path) not in ("cli", "__main__")
    ]
    assert users == []


def top_package_of(path: Path) -> str:
    return package_of(path) if path.is_relative_to(ROOT / "lfobench") else path.relative_to(ROOT).parts[0]


def test_the_harness_knows_no_method_and_no_suite() -> None:
    """It finds them by name, through the registry."""
    violations = [
        place(path, line, name)
        for path in sources("lfobench")
        for line, name in imported(path)
        if name.split(".")[0] in ("methods", "suites")
    ]
    assert violations == []


def test_methods_know_the_contract_and_nothing_else() -> None:
    violations = []
    for path in sources("methods"):
        for line, name in imported(path):
            head = name.split(".")[0]
            allowed = head in METHODS_MAY_IMPORT or head in sys.stdlib_module_names
            if not allowed and not name.startswith(("lfobench.contract.", "lfobench.nn.", "lfobench.randomness.")):
                violations.append(place(path, line, name))
    assert violations == []


FILES_AND_PRINTING = {
    "builtins",
    "csv",
    "io",
    "os",
    "pathlib",
    "pickle",
    "rich",
    "shutil",
    "subprocess",
    "sys",
    "tempfile",
    "typer",
    "gymnasium",
}


def test_methods_touch_no_file_and_no_simulator() -> None:
    violations = [
        place(path, line, name)
        for path in sources("methods")
        for line, name in imported(path)
        if name.split(".")[0] in FILES_AND_PRINTING
    ]
    assert violations == []


def test_suites_are_data() -> None:
    """A suite file only declares; reading of weights and simulation lie in packages below, distillation in tools/."""
    violations = []
    for path in sources("suites"):
        forbidden = {"rich", "typer", "methods"}
        if path.parent == ROOT / "suites":
            forbidden |= FILES_AND_PRINTING
        for line, name in imported(path):
            beyond = name.startswith("lfobench.") and not name.startswith(
                ("lfobench.contract", "lfobench.errors", "lfobench.text")
            )
            if beyond or name.split(".")[0] in forbidden:
                violations.append(place(path, line, name))
    assert violations == []


WRITERS = {"write_bytes", "write_text", "save_file", "mkdir", "unlink", "rename", "replace_file"}


def test_suites_write_no_files() -> None:
    """Suites and demonstrators, which every run imports, read weights and write nothing."""
    violations = []
    for path in sources("suites"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                if called in WRITERS or called == "print":
                    violations.append(place(path, node.lineno, called))
    assert violations == []


@pytest.mark.parametrize("package", ["lfobench", "methods", "suites", "tools", "benchmarks"])
def test_every_module_says_what_it_is_for(package: str) -> None:
    silent = [str(path) for path in sources(package) if not ast.get_docstring(ast.parse(path.read_text("utf-8")))]
    assert silent == []


def test_the_wheel_holds_the_product_alone() -> None:
    """Neither tools nor benchmarks are needed by anything that ships."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == ["lfobench", "methods", "suites"]
    violations = [
        place(path, line, name)
        for package in ("lfobench", "methods", "suites")
        for path in sources(package)
        for line, name in imported(path)
        if name.split(".")[0] in ("tools", "benchmarks", "tests")
    ]
    assert violations == []
