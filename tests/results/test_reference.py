"""The committed reference records are what their page says: readable, whole, and those of its commands.

A command of the page that begins with ``$`` was given at an earlier revision, which the page names.
"""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from helpers_cli import InProcess

from lfobench.record import Record
from lfobench.records.folder import RecordFolder

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
PAGE = (REFERENCE / "README.md").read_text(encoding="utf-8").replace("\\\n", " ")
COMMANDS = [shlex.split(line) for line in re.findall(r"^lfobench (run .*)$", PAGE, flags=re.MULTILINE)]
EARLIER = sorted(set(re.findall(r"^\$ lfobench .*--out (results/reference/\S+)", PAGE, flags=re.MULTILINE)))
ONLY_OF_RUN = ("--workers",)


def why(command: list[str]) -> list[str]:
    """The same options for ``why``; ``--out`` is given from the root of the repository."""
    words, kept = iter(command[1:]), []
    for word in words:
        if word in ONLY_OF_RUN:
            next(words)
        elif word == "--out":
            kept += [word, str(REFERENCE.parents[1] / next(words))]
        else:
            kept.append(word)
    return ["why", *kept, "--json"]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[-1])
def test_every_documented_run_has_its_record(command: list[str], lfobench_command: InProcess) -> None:
    outcome = lfobench_command(*why(command))
    assert outcome.code == 0
    assert outcome.err == "", "no file there is foreign, edited or a copy"
    answers = json.loads(outcome.out)
    assert answers
    # Differences of a reused record are those of its data: this machine's cache may hold data of other rounding.
    assert {answer["run"]: answer["reused"] for answer in answers} == {answer["run"]: True for answer in answers}


def test_no_record_is_undocumented(lfobench_command: InProcess) -> None:
    documented = [answer["run"] for command in COMMANDS for answer in json.loads(lfobench_command(*why(command)).out)]
    folders = [
        folder
        for folder in REFERENCE.iterdir()
        if folder.is_dir() and f"results/reference/{folder.name}" not in EARLIER
    ]
    found = [_label(one) for folder in folders for one in RecordFolder(folder).read_all().records]
    assert sorted(found) == sorted(documented)


@pytest.mark.parametrize("folder", EARLIER)
def test_records_of_an_earlier_revision_are_whole_and_the_page_names_it(folder: str) -> None:
    read = RecordFolder(REFERENCE.parents[1] / folder).read_all()
    assert read.records and not read.warnings
    assert all(str(record.provenance["source_revision"])[:7] in PAGE for record in read.records)


def _label(record: Record) -> str:
    tuned = "".join(f" {field}={value}" for field, value in record.identity.get("tuned", {}).items())
    return f"{record.method}:{record.identity['preset']} {record.task}{tuned} seed {record.seed}"


def test_the_readme_shows_the_table_that_the_records_give(lfobench_command: InProcess) -> None:
    readme = (REFERENCE.parents[1] / "README.md").read_text(encoding="utf-8")
    table = lfobench_command("table", "--out", REFERENCE / "locomotion-quick", "--format", "markdown")
    assert table.code == 0
    assert table.out in readme
