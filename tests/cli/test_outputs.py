"""Every view, whatever the records hold and wherever its output goes: no traceback, no number or name that harms."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from helpers_cli import InProcess, arguments, environment, process
from helpers_folders import with_provenance, write_crash, write_records
from helpers_records import make_cell, make_record

import lfobench
from lfobench.record import Metrics, Record

HOSTILE = "evil\x1b[31m\n\u202erev\x9b2J"
FORBIDDEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u202a-\u202e\u2066-\u2069]")
LONG = re.compile(r"[0-9]{19,}")
NOT_A_NUMBER = re.compile(r"(?<![A-Za-z])(inf|nan)(?![A-Za-z])", re.IGNORECASE)

VIEWS: list[tuple[str, ...]] = [
    ("table",),
    *(("table", "--format", name) for name in ("markdown", "latex", "csv", "json", "html")),
    ("power",),
    ("power", "--json"),
    ("compare", "A", "B"),
    ("compare", "A", "B", "--json"),
    ("status",),
    ("status", "--json"),
    ("report", "--to", "report.html"),
    *(("plot", kind, "--to", f"{kind}.svg") for kind in ("curves", "scores", "profiles", "improvement", "metrics")),
]
IDS = [" ".join(view) for view in VIEWS]


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def measured(records: list[Record]) -> list[Record]:
    """The records with a training metric."""
    row = Metrics(stage="train", step=1000, values={"loss": 0.5})
    return [record.model_copy(update={"metrics": [row]}) for record in records]


def exploding(value: float = 1.7e308) -> list[Record]:
    """Three seeds of two methods, the last of which returns an absurd number."""
    return measured([*make_cell([50.0, 51.0, 52.0]), *make_cell([40.0, 41.0, value / 10.0], "oril")])


def everything(view: tuple[str, ...], command: InProcess, folder: str, names: tuple[str, str]) -> str:
    """All that a view writes, on its streams and into its file."""
    methods = {"A": names[0], "B": names[1]}
    done = command(*(methods.get(word, word) for word in view), "--out", folder)
    assert done.code == 0, done
    files = [Path(word) for word in view if word.endswith((".html", ".svg"))]
    return "".join([done.out, done.err, *(file.read_text(encoding="utf-8") for file in files)])


# --- numbers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS, ids=IDS)
def test_one_run_that_explodes_is_named_and_the_rest_is_shown(
    view: tuple[str, ...], lfobench_command: InProcess
) -> None:
    write_records(Path("runs"), exploding())
    text = everything(view, lfobench_command, "runs", ("dilo", "oril"))
    assert "oril on hopper-random-expert, seed 2 exploded" in text
    assert "1.7e308" in text
    if not any(word.endswith((".html", ".svg")) for word in view):
        assert not NOT_A_NUMBER.search(text) and not LONG.search(text)


@pytest.mark.filterwarnings("ignore:.*exploded:UserWarning")
@pytest.mark.parametrize("returns", [1.7e308, -1.7e308, 1.1e16])
def test_a_run_that_exploded_counts_as_one_that_diverged(returns: float) -> None:
    table = lfobench.table(write_records(Path("runs"), exploding(returns)))
    cell = next(cell for _, column, cell in table.cells() if column.method == "oril")
    assert cell is not None and cell.summary is not None
    assert (cell.diverged_seeds, cell.summary.mean, cell.summary.n) == ((2,), 27.0, 3)
    note = next(note.text for note in table.notes if note.label == "Diverged")
    assert "oril on hopper-random-expert, seed 2 (step 1,000)" in note


def test_a_frame_ends_where_the_run_exploded_and_warns_both_times() -> None:
    record = make_record(50.0)
    evaluations = [*record.evaluations]
    evaluations[3] = evaluations[3].model_copy(update={"returns": [500.0, 1.7e308]})
    folder = write_records(Path("runs"), [record.model_copy(update={"evaluations": evaluations})])
    for _ in range(2):
        with pytest.warns(UserWarning, match="an episode at step 4,000 returned 1.7e308"):
            frame = lfobench.load(folder)
        assert list(frame["step"]) == [1000, 2000, 3000]
        assert set(frame["status"]) == {"diverged"}
        assert set(frame["score"]) == {50.0}


@pytest.mark.parametrize("name", ["terminal", "markdown", "latex", "csv", "json", "html"])
def test_numbers_of_a_trillion_are_short(name: str, lfobench_command: InProcess) -> None:
    folder = write_records(Path("runs"), make_cell([1.2e12, 1.2e12]) + make_cell([-1.2e12, -1.2e12], "oril"))
    text = lfobench_command("table", "--out", folder, "--format", name).out
    shown = {"latex": r"1.2\mathrm{e}12", "csv": "1200000000000.0", "json": "1200000000000.0"}.get(name, "1.2e12")
    assert shown in text and f"-{shown}" in text
    assert not LONG.search(text)


@pytest.mark.slow
def test_whatever_provenance_claims_is_no_number(lfobench_command: InProcess) -> None:
    records = [
        with_provenance(record, demonstration_score=value, seconds={"train": value, "evaluate": 1e308})
        for record, value in zip(exploding(500.0), (1e308, 10**400, -1e308, True, "1", None), strict=True)
    ]
    folder = write_records(Path("runs"), records)
    for view in VIEWS:
        everything(view, lfobench_command, str(folder), ("dilo", "oril"))


def test_reference_returns_that_no_float_can_scale_are_refused(lfobench_command: InProcess) -> None:
    environment = {**make_record(0.0).identity["environment"], "expert_return": 1e300}
    record = make_record(50.0, seed=9)
    broken = record.model_copy(update={"identity": record.identity | {"environment": environment}})
    folder = write_records(Path("runs"), [make_record(50.0), broken])
    shown = lfobench_command("table", "--out", folder)
    assert shown.code == 0 and "beyond ±1e+100" in shown.err


# --- names -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS, ids=IDS)
def test_control_codes_and_marks_of_direction_reach_no_output(
    view: tuple[str, ...], lfobench_command: InProcess
) -> None:
    records = measured(
        [
            record
            for method in (HOSTILE, "oril")
            for record in make_cell([50.0, 51.0, 52.0], method, row=HOSTILE, group=HOSTILE, task="hop\nper\u202e")
        ]
    )
    for number, record in enumerate(records):
        write_records(Path("runs") / str(number), [record])
    write_crash(Path("runs"), make_record(0.0, HOSTILE, 7, row=HOSTILE, group=HOSTILE, task="hop\nper\u202e"))
    methods = {"A": "oril", "B": "evil\\x1b[31m \\u202erev\\x9b2J"}
    done = lfobench_command(*(methods.get(word, word) for word in view), "--out", "runs")
    assert done.code == 0, done
    files = [Path(word) for word in view if word.endswith((".html", ".svg"))]
    for text in (done.out, done.err, *(file.read_text(encoding="utf-8") for file in files)):
        assert not FORBIDDEN.search(text)
    assert "evil" in "".join([done.out, *(file.read_text(encoding="utf-8") for file in files)])
    if "--json" in view or "json" in view:
        json.loads(done.out)


def test_json_gives_names_back_as_they_were(lfobench_command: InProcess) -> None:
    folder = write_records(Path("runs"), [make_record(50.0, "a\u202eb\x9b", task="t")])
    found = json.loads(lfobench_command("table", "--out", folder, "--format", "json").out)
    assert found["columns"][0]["method"] == "a\u202eb\x9b"


@pytest.mark.parametrize("name", ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1"])
def test_a_name_that_begins_like_a_formula_has_an_apostrophe(name: str, lfobench_command: InProcess) -> None:
    records = [make_record(score, name, seed) for seed, score in enumerate((-50.0, -51.0))]
    folder = write_records(Path("runs"), records)
    frame = pd.read_csv(_kept(lfobench_command("table", "--out", folder, "--format", "csv").out))
    assert not any(text.startswith(tuple("=+-@\t\r")) for text in frame["method"])
    assert frame["method"][0].endswith(name.strip())
    assert frame["mean"][0] == -50.5 and frame["scores"][0] == "-50.0 -51.0"


def _kept(text: str) -> Path:
    path = Path("kept.csv")
    path.write_text(text, encoding="utf-8")
    return path


# --- where it goes ---------------------------------------------------------------------------------------------------


@pytest.fixture
def folder() -> Path:
    crashed = make_record(0.0, "mine", 0)
    records = [*make_cell([50.0, 51.0]), *make_cell([40.0, 41.0], "bc", sees_expert_actions=True)]
    path = write_records(Path("runs"), measured(records))
    write_crash(path, crashed)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("view", [*VIEWS, ("ls", "methods"), ("audit", "dilo-2024"), ("--help",)], ids=str)
def test_ascii_and_narrow_terminals_read_every_view(view: tuple[str, ...], folder: Path) -> None:
    names = {"A": "dilo", "B": "bc"}
    given = [names.get(word, word) for word in view]
    out = [] if view[0] in ("ls", "audit", "--help") else ["--out", str(folder)]
    extra = ["--scope", "all"] if view[0] == "power" else []
    command = arguments(*given, *out, *extra)
    done = process(command, env={"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "COLUMNS": "30"})
    assert done.code == 0 and "Traceback" not in done.err, done.err
    assert (done.out + done.err).isascii()
    if given == ["table"]:
        assert "50.5+-0.7" in done.out and "crashed !1" in done.out
    if "json" in given:
        assert "±" not in done.out and json.loads(done.out)["rows"]


def test_ascii_keeps_other_names_readable_for_json(lfobench_command: InProcess) -> None:
    write_records(Path("runs"), [make_record(50.0, "méthode", task="t")])
    done = process(arguments("table", "--out", "runs"), env={"PYTHONIOENCODING": "ascii"})
    assert done.code == 0 and r"m\u00e9thode" in done.out


def _into_full(command: list[str]) -> subprocess.CompletedProcess[str]:
    with Path("/dev/full").open("w") as full:
        return subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, env=environment(), timeout=120, check=False
        )


def _into_closed(command: list[str]) -> subprocess.CompletedProcess[str]:
    # The reader is gone before anything is written.
    script = "import os, sys; r, w = os.pipe(); os.close(r); os.dup2(w, 1); os.execv(sys.argv[1], sys.argv[1:])"
    return subprocess.run(
        [sys.executable, "-c", script, *command],
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        timeout=120,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("view", [("table",), ("table", "--format", "csv"), ("status", "--json"), ("--help",)], ids=str)
@pytest.mark.parametrize("into", [_into_full, _into_closed])
def test_output_that_cannot_be_written_is_one_line(
    view: tuple[str, ...], into: Callable[[list[str]], subprocess.CompletedProcess[str]], folder: Path
) -> None:
    done = into(arguments(*view, *(() if view[0] == "--help" else ("--out", folder))))
    assert done.returncode not in (0, 120), done
    assert len(done.stderr.splitlines()) == 1 and "Standard output cannot be written" in done.stderr


def test_messages_that_cannot_be_written_stop_nothing(folder: Path) -> None:
    damaged = folder / "records" / "x.json"
    damaged.write_text("{", encoding="utf-8")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            arguments("table", "--out", folder),
            stdout=subprocess.PIPE,
            stderr=full,
            text=True,
            env=environment(),
            timeout=120,
            check=False,
        )
    assert done.returncode == 0 and "50.5" in done.stdout


# --- crashes ---------------------------------------------------------------------------------------------------------


def test_status_shows_crashed_runs_with_their_message(folder: Path, lfobench_command: InProcess) -> None:
    shown = lfobench_command("status", "--out", folder).out
    assert "1 crashed runs" in shown and "mine on hopper-random-expert, seed 0: gone" in shown
    cells = json.loads(lfobench_command("status", "--out", folder, "--json").out)["cells"]
    assert {cell["method"]: cell["crashed"] for cell in cells} == {"dilo": [], "bc": [], "mine": [0]}


def test_a_method_of_which_every_run_crashed_is_in_the_table(folder: Path, lfobench_command: InProcess) -> None:
    assert "crashed !1" in lfobench_command("table", "--out", folder).out
    assert "mine" not in lfobench_command("table", "--out", folder, "--methods", "dilo,bc").out
