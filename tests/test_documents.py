"""The documents: short where they must be, links that lead somewhere, code that runs."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer.main
from helpers_cli import InProcess

from lfobench.cli import app
from lfobench.contract.method import Shapes
from lfobench.engine.method_check import require_sound
from lfobench.registry import load_method

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_is_read_in_one_go() -> None:
    assert len(README.splitlines()) <= 130


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_local_links_lead_somewhere(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []


PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMANDS = [
    (page.name, line.strip())
    for page in PAGES
    for block in re.findall(r"```console\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    for line in block.replace("\\\n", " ").splitlines()
]


@pytest.mark.parametrize(("page", "line"), [each for each in COMMANDS if each[1].startswith("lfobench ")])
def test_every_documented_command_is_understood(page: str, line: str) -> None:
    """Its names, arguments and options are those of the command line; nothing is carried out."""
    words = shlex.split(line.split(" > ")[0], comments=True)
    name, command = words.pop(0), typer.main.get_command(app)
    while commands := getattr(command, "commands", None):
        name = words.pop(0)
        assert name in commands, line
        command = commands[name]
    assert command.make_context(name, words).args == []


def test_every_documented_make_target_exists() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = {line.split()[1] for _, line in COMMANDS if line.startswith("make ")}
    assert named
    assert named <= targets


def test_the_citation_names_this_version_and_licence() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for field in ("version", "license"):
        assert re.findall(rf"^{field}: (.*)$", citation, re.MULTILINE) == [project[field]]


def test_the_readme_s_method_keeps_every_rule(tmp_path: Path) -> None:
    (source,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(source.splitlines()) <= 40
    (tmp_path / "mine.py").write_text(source, encoding="utf-8")
    method = load_method(str(tmp_path / "mine.py"))
    require_sound(method, method.Config(), Shapes(4, 2))


@pytest.mark.slow
def test_the_first_run_of_the_tutorial_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lfobench_command: InProcess
) -> None:
    monkeypatch.chdir(tmp_path)
    commands = [shlex.split(line)[1:] for page, line in COMMANDS if page == "tutorial.md" and "--out first" in line]
    assert [command[0] for command in commands] == ["run", "status", "table", "plot", "compare", "report"]
    for command in commands:
        assert lfobench_command(*command).code == 0, command
    assert (tmp_path / "first" / "curves.pdf").read_bytes().startswith(b"%PDF")
    assert "<html" in (tmp_path / "first" / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_site_builds_and_every_link_holds(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="the documentation's generator is not installed")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(tmp_path)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "lfobench compare" in (tmp_path / "cli.html").read_text(encoding="utf-8")
    for page, shown in (("data.html", "own_file"), ("write_a_suite.html", "Balancing")):
        assert f">{shown}</span>" in (tmp_path / page).read_text(encoding="utf-8"), "the example of the page is there"
    outside = {
        link
        for page in tmp_path.rglob("*.html")
        for link in re.findall(r'(?:src|rel="stylesheet" href)="(https?://[^"]+)"', page.read_text(encoding="utf-8"))
    }
    assert outside == set(), "a page needs no network"
