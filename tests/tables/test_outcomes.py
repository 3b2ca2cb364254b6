"""How episodes ended: counts by task, method and outcome, in every format that has them."""

from __future__ import annotations

import csv
import io
import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from helpers_records import endings, make_cell, make_counted
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from lfobench.errors import UserError
from lfobench.record import Failure, Record
from lfobench.tables.outcomes import FORMATS, OutcomeTable, document, export_outcomes, outcome_table

FIXED = ["success"] * 6 + ["cup hit"] * 3 + ["stalled"]


@pytest.fixture
def records() -> list[Record]:
    return [
        *(make_counted(FIXED, ["out of time", "success"], seed=seed) for seed in range(2)),
        make_counted(FIXED, ["out of time", "success"], seed=2, diverged_at=5),
        make_counted(["success"] * 10, ["success"] * 2, "bco"),
        make_counted(endings(0, 10, "emergency stop"), group="fixed-start"),
    ]


@pytest.fixture
def table(records: list[Record]) -> OutcomeTable:
    crashed = make_counted(endings(0, 10), method="bco", seed=4, protocol=records[0].identity["protocol"])
    failure = Failure(identity_hash="f", identity=crashed.identity, labels=crashed.labels, error="x", traceback=[])
    return outcome_table(records, failures=[failure])


def drawn(table: OutcomeTable, width: int = 120) -> str:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    console.print(document(table))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_every_episode_is_counted_once(table: OutcomeTable) -> None:
    counts = {(line.row.task, line.column.label): dict(line.counts) for line in table.lines}
    assert counts == {
        ("safe-manipulation-few-trajectories", "dilo"): {
            "success": 14,
            "cup hit": 6,
            "stalled": 2,
            "out of time": 2,
            "diverged": 12,
        },
        ("safe-manipulation-few-trajectories", "bco"): {"success": 12},
        ("safe-manipulation-fixed-start", "dilo"): {"emergency stop": 10},
        ("safe-manipulation-fixed-start", "bco"): {},
    }


def test_outcomes_stand_in_one_order(table: OutcomeTable) -> None:
    assert table.outcomes == ("success", "emergency stop", "cup hit", "out of time", "stalled", "diverged")


@settings(max_examples=30)
@given(st.lists(st.lists(st.sampled_from(["success", "a", "b", "c"]), min_size=3, max_size=3), min_size=1, max_size=4))
def test_counts_are_a_plain_count(seeds: list[list[str]]) -> None:
    found = outcome_table([make_counted(fixed, seed=seed) for seed, fixed in enumerate(seeds)])
    (line,) = found.lines
    assert line.counts == Counter(outcome for fixed in seeds for outcome in fixed)
    assert line.episodes == 3 * len(seeds)
    assert sum(line.percent(outcome) for outcome in found.outcomes) == pytest.approx(100.0)


def test_the_terminal(table: OutcomeTable) -> None:
    body, _, footnote = drawn(table).partition("\n\n")
    assert [" ".join(line.split()) for line in body.splitlines() if not line.startswith("─")] == [
        "episodes success emergency stop cup hit out of time stalled diverged",
        "safe-manipulation-few-trajectories",
        "dilo ✗1 36 14 (39%) 0 6 (17%) 2 (6%) 2 (6%) 12 (33%)",
        "bco !1 12 12 (100%) 0 0 0 0 0",
        "safe-manipulation-fixed-start",
        "dilo 10 0 10 (100%) 0 0 0 0",
        "bco – – – – – – –",
    ]
    assert footnote.lstrip().startswith("Outcomes")


def test_the_footnote_keeps_what_bears_on_outcomes(table: OutcomeTable) -> None:
    labels = [note.label for note in table.notes]
    assert labels == [
        "Outcomes",
        "Source",
        "Protocol",
        "Simulator",
        "Seeds",
        "Presets",
        "Diverged",
        "Failed",
        "Missing",
    ]


def test_csv_has_a_line_per_outcome(table: OutcomeTable) -> None:
    lines = list(csv.DictReader(io.StringIO(export_outcomes(table, "csv"))))
    assert len(lines) == 3 * len(table.outcomes)
    first = lines[0]
    assert (first["outcome"], first["count"], first["episodes"]) == ("success", "14", "36")
    assert float(first["percent"]) == pytest.approx(100 * 14 / 36)
    assert (first["seeds"], first["diverged_seeds"]) == ("0 1 2", "2")
    for task in {line["task"] for line in lines}:
        for method in {line["method"] for line in lines if line["task"] == task}:
            those = [line for line in lines if (line["task"], line["method"]) == (task, method)]
            assert sum(int(line["count"]) for line in those) == int(those[0]["episodes"])


def test_json(table: OutcomeTable) -> None:
    found = json.loads(export_outcomes(table, "json"))
    assert found["outcomes"] == list(table.outcomes)
    assert found["rows"][0]["outcomes"]["diverged"] == 12
    assert found["rows"][0]["seeds"] == [0, 1, 2]
    assert found["rows"][1]["failed_seeds"] == [4]
    assert (found["rows"][3]["episodes"], found["rows"][3]["seeds"]) == (0, [])


def test_markdown(table: OutcomeTable) -> None:
    lines = export_outcomes(table, "markdown").splitlines()
    assert lines[0] == (
        "| Task | Method | episodes | success | emergency stop | cup hit | out of time | stalled | diverged |"
    )
    assert lines[2].startswith("| safe-manipulation-few-trajectories | dilo ✗1 | 36 | 14 (39%) | 0 |")
    assert lines[3].startswith("|  | bco !1 | 12 |")


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no TeX engine")
def test_latex_compiles(table: OutcomeTable, tmp_path: Path) -> None:
    text = export_outcomes(table, "latex")
    assert r"14 (39\%)" in text
    (tmp_path / "t.tex").write_text(
        f"\\documentclass{{article}}\\usepackage{{booktabs}}\\begin{{document}}\n{text}\\end{{document}}\n",
        encoding="utf-8",
    )
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", "t.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, errors="replace", check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Missing character" not in (tmp_path / "t.log").read_text(encoding="latin-1")


def test_a_rounded_share_never_claims_none_or_all() -> None:
    rare = outcome_table([make_counted(["success"] + ["stalled"] * 299)])
    (line,) = [line for line in drawn(rare).splitlines() if line.strip().startswith("dilo")]
    assert "1 (<1%)" in line and "299 (>99%)" in line


def test_what_is_not_there_is_refused(records: list[Record]) -> None:
    with pytest.raises(UserError, match=r"no format 'html'.*terminal, markdown, latex, csv, json"):
        export_outcomes(outcome_table(records), "html")
    assert set(FORMATS) == {"markdown", "latex", "csv", "json"}
    with pytest.raises(UserError, match=r"--outcomes counts how episodes ended, and 2 of 2 records.*Leave those"):
        outcome_table(make_cell([1.0, 2.0]))
    with pytest.raises(UserError, match="no records"):
        outcome_table([])
