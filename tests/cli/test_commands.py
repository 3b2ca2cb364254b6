"""What a user types and what comes back, in this process; one smoke comparison of every method on hopper."""

from __future__ import annotations

import csv
import io
import json
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np
import pytest
from helpers_cli import InProcess, assert_refused
from helpers_engine import HOPPER_TASK, TINY, smoke_cell
from helpers_folders import with_provenance, write_crash, write_records
from helpers_records import make_cell, make_record
from pydantic import Field as ConfigField
from pydantic import PositiveFloat
from safetensors.numpy import load_file

from lfobench import registry
from lfobench.cells.cell import PROTOCOLS, Run
from lfobench.cli import app, progress
from lfobench.contract.method import MethodConfig
from lfobench.files import locked
from lfobench.records.folder import RecordFolder
from lfobench.records.sealed import SEAL
from lfobench.registry import load_method, load_suite, method_names
from lfobench.stats.options import Test
from lfobench.text import content_hash

METHODS = "dilo,smodice,oril,bco,bc,bc-expert"
SMOKE = ("--methods", METHODS, "--tasks", HOPPER_TASK, "--protocol", "smoke", "--seeds", "0-1")
TINY_SMOKE = ("--suite", TINY, "--tasks", "pole-random-expert", "--protocol", "smoke", "--seeds", "0")


@pytest.fixture
def compared(shared_cache: Path, lfobench_command: InProcess) -> Path:
    """The records of the comparison, made by the first test that asks; read-only."""
    records = shared_cache.parent / "compared"
    with locked(shared_cache.parent / "compared.lock", "--out", wait=True):
        if not records.exists():
            making = shared_cache.parent / "compared-in-the-making"
            outcome = lfobench_command("run", *SMOKE, "--workers", "1", "--out", making)
            assert outcome.code == 0, outcome
            making.rename(records)
    return records


# --- the whole way ---------------------------------------------------------------------------------------------------


def test_run_leaves_a_record_and_a_policy_per_run_and_nothing_else(compared: Path) -> None:
    read = RecordFolder(compared).read_all()
    assert read.warnings == []
    assert sorted((record.method, record.seed) for record in read.records) == sorted(
        (method, seed) for method in METHODS.split(",") for seed in (0, 1)
    )
    assert all(record.status == "finished" for record in read.records)
    kinds = {(path.relative_to(compared).parts[0], path.suffix) for path in compared.rglob("*") if path.is_file()}
    assert kinds == {("records", ".json"), ("policies", ".safetensors")}


def test_no_wait_leaves_runs_to_whoever_trains_them(
    tmp_path: Path, shared_cache: Path, lfobench_command: InProcess
) -> None:
    folder, run = RecordFolder(tmp_path), Run(smoke_cell("bc"), 1)
    folder.checkpoints.mkdir()
    command = ("run", "--methods", "bc", *TINY_SMOKE[:-1], "0-1", "--workers", "1", "--out", tmp_path, "--no-wait")
    with locked(folder.lock(run), "--out"):
        outcome = lfobench_command(*command)
    assert outcome.code == 3
    assert "1 run left to another process" in outcome.err
    assert "Done" not in outcome.err
    assert [record.seed for record in folder.read_all().records] == [0]
    assert lfobench_command(*command).code == 0


def test_the_same_command_does_nothing_again(compared: Path, lfobench_command: InProcess) -> None:
    before = {path: path.stat().st_mtime_ns for path in compared.rglob("*")}
    outcome = lfobench_command("run", *SMOKE, "--workers", "1", "--out", compared)
    assert outcome.code == 0
    assert "nothing" in outcome.out
    assert {path: path.stat().st_mtime_ns for path in compared.rglob("*")} == before


def test_checkpoint_and_lock_of_a_run_that_was_killed_at_its_very_end_are_removed(
    compared: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    shutil.copytree(compared, tmp_path / "runs")
    folder = RecordFolder(tmp_path / "runs")
    cell = smoke_cell("bc", HOPPER_TASK, "locomotion")
    finished, other = (Run(cell, seed) for seed in (1, 2))
    for run in (finished, other):
        folder.checkpoint(run).parent.mkdir(exist_ok=True)
        folder.checkpoint(run).write_bytes(b"left")
        folder.lock(run).touch()
    assert lfobench_command("run", *SMOKE, "--workers", "1", "--out", folder.root).code == 0
    assert not folder.checkpoint(finished).exists() and not folder.lock(finished).exists()
    assert folder.checkpoint(other).exists() and folder.lock(other).exists(), "another command's, which may go on"


def test_why_says_reused(compared: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("why", *SMOKE, "--out", compared)
    assert outcome.code == 0
    assert outcome.out.count("reused") == 12
    answers = json.loads(lfobench_command("why", *SMOKE, "--out", compared, "--json").out)
    assert [(answer["reused"], answer["differences"]) for answer in answers] == [(True, [])] * 12


def test_why_names_the_fields_that_make_it_run_again(compared: Path, lfobench_command: InProcess) -> None:
    command = ("why", *SMOKE, "--set", "dilo.tau=3", "--out", compared)
    answers = json.loads(lfobench_command(*command, "--json").out)
    assert [answer["reused"] for answer in answers] == [False] * 2 + [True] * 10
    assert answers[0]["differences"] == ["config.tau: 0.06 -> 3.0", "set.tau: absent -> 3.0"]
    assert "config.tau: 0.06 -> 3.0" in lfobench_command(*command).out


def test_the_plan_counts_what_is_done(compared: Path, lfobench_command: InProcess) -> None:
    command = ("run", *SMOKE[:-1], "0-2", "--out", compared, "--dry-run", "--json")
    plan = json.loads(lfobench_command(*command).out)
    assert sum(run["done"] for run in plan["runs"]) == 12
    assert len(plan["runs"]) == 18
    assert plan["protocol"] == "smoke"
    assert plan["estimated_seconds"] > 0


def test_status_counts_seeds(compared: Path, lfobench_command: InProcess) -> None:
    status = json.loads(lfobench_command("status", "--out", compared, "--json").out)
    assert {(cell["method"], tuple(cell["finished"]), tuple(cell["diverged"])) for cell in status["cells"]} == {
        (method, (0, 1), ()) for method in METHODS.split(",")
    }
    assert status["runs_in_progress"] == 0
    assert "12 records" in lfobench_command("status", "--out", compared).out


def test_status_keeps_variants_of_a_method_apart(tmp_path: Path, lfobench_command: InProcess) -> None:
    run = ("run", "--methods", "bc", *TINY_SMOKE, "--workers", "1", "--out", tmp_path)
    for changes in ((), ("--set", "bc.learning_rate=0.5"), ("--steps", "25")):
        assert lfobench_command(*run, *changes).code == 0
    cells = json.loads(lfobench_command("status", "--out", tmp_path, "--json").out)["cells"]
    assert [(cell["preset"], cell["protocol"], cell["finished"]) for cell in cells] == [
        ("released", "smoke", [0]),
        ("released", "smoke, 25 steps", [0]),
        ("released, learning_rate=0.5", "smoke", [0]),
    ]


def terminal(text: str) -> None:
    assert "─" in text


def markdown(text: str) -> None:
    assert "|---" in text.replace(" ", "") or "|:--" in text.replace(" ", "")


def latex(text: str) -> None:
    assert "\\begin{tabular" in text
    assert text.count("{") == text.count("}")


def comma_separated(text: str) -> None:
    rows = list(csv.DictReader(io.StringIO(text)))
    assert {row["method"] for row in rows if row["column_group"] != "expert"} == set(METHODS.split(","))


def parses(text: str) -> None:
    columns = json.loads(text)["columns"]
    assert [column["method"] for column in columns if column["group"] == "Expert"] == ["demonstration"]


@pytest.mark.parametrize(
    ("format_name", "check"),
    [("terminal", terminal), ("markdown", markdown), ("latex", latex), ("csv", comma_separated), ("json", parses)],
)
@pytest.mark.parametrize("statistic", ["last5", "last", "best"])
def test_table(
    format_name: str, check: Callable[[str], None], statistic: str, compared: Path, lfobench_command: InProcess
) -> None:
    outcome = lfobench_command("table", "--out", compared, "--format", format_name, "--stat", statistic)
    assert outcome.code == 0
    assert outcome.err == ""
    check(outcome.out)
    for method in METHODS.split(","):
        assert method in outcome.out
    if format_name != "csv":
        assert "smoke" in outcome.out, "the footnote names the protocol"
        assert "mujoco" in outcome.out.lower()


def test_table_of_some_methods(compared: Path, lfobench_command: InProcess) -> None:
    rows = csv.DictReader(
        io.StringIO(lfobench_command("table", "--out", compared, "--methods", "bc,dilo", "--format", "csv").out)
    )
    assert {row["method"] for row in rows} == {"bc", "dilo", "demonstration"}


@pytest.fixture
def synthetic(tmp_path: Path) -> Path:
    """Five seeds of two methods on two tasks, with a crash: a winner, a tie, and the demonstration's score."""
    records = [
        with_provenance(record, demonstration_score=103.0)
        for row, behind in (("hopper", 40.0), ("ant", 0.5))
        for method, mean in (("dilo", 90.0), ("smodice", 90.0 - behind))
        for record in make_cell([mean + wobble for wobble in (-2.0, 1.0, 0.0, 3.0, -1.0)], method, row=row)
    ]
    folder = write_records(tmp_path / "synthetic", records)
    write_crash(folder, make_record(0.0, seed=5))
    return folder


def highlighted(text: str) -> dict[str, set[str]]:
    """By task, from CSV."""
    found: dict[str, set[str]] = {}
    for line in csv.DictReader(io.StringIO(text)):
        found.setdefault(line["row"], set()).update([line["column"]] if line["highlighted"] == "1" else [])
    return found


@pytest.mark.parametrize("test", get_args(Test))
def test_table_by_every_test(test: str, synthetic: Path, lfobench_command: InProcess) -> None:
    """Two starts only, so no paired test by relabelling can tell anything apart; the footnote says so."""
    outcome = lfobench_command("table", "--out", synthetic, "--test", test, "--format", "csv")
    assert (outcome.code, outcome.err) == (0, "")
    rows = list(csv.DictReader(io.StringIO(outcome.out)))
    assert {row["test"] for row in rows} == {test}
    hopper = {"dilo"} if test not in ("wilcoxon", "paired-permutation") else {"dilo", "smodice"}
    assert highlighted(outcome.out)["hopper"] == hopper
    assert {row["outcome"] for row in rows} <= {"better", "undecided"}
    shown = lfobench_command("table", "--out", synthetic, "--test", test)
    assert (shown.code, shown.err) == (0, "")
    assert ("so no row could have come out significant" in " ".join(shown.out.split())) == (len(hopper) == 2)


@pytest.mark.parametrize("test", get_args(Test))
def test_table_of_real_records_by_every_test(test: str, compared: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("table", "--out", compared, "--test", test, "--scope", "all", "--correction", "bh")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Correction for multiple comparisons: Benjamini-Hochberg" in " ".join(outcome.out.split())


def test_table_with_all_four_knobs(synthetic: Path, lfobench_command: InProcess) -> None:
    knobs = ("--test", "student", "--scope", "all", "--correction", "holm", "--alpha", "0.01", "--stat", "at:3000")
    found = json.loads(lfobench_command("table", "--out", synthetic, *knobs, "--format", "json").out)
    assert found["rule"] == {"test": "student", "scope": "all", "correction": "holm", "alpha": 0.01}
    assert found["statistic"] == "at:3000"
    assert [row["outcome"] for row in found["rows"]] == ["better", "undecided"]
    assert [column["group"] for column in found["columns"]] == ["No expert actions", "No expert actions", "Expert"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--test", "welsh"), ("Unknown test 'welsh'", "Did you mean 'welch'")),
        (("--scope", "groups"), ("Unknown scope 'groups'", "Did you mean 'group'")),
        (("--correction", "bonferroni"), ("Unknown correction 'bonferroni'", "bh, holm, none")),
        (("--stat", "mean"), ("Unknown statistic 'mean'", "last5, last, best, at:STEP")),
        (("--stat", "at:soon"), ("Unknown statistic 'at:soon'", "at:10000")),
        (("--stat", "at:1500"), ("was not evaluated at step 1500", "1000, 2000, 3000, 4000, 5000")),
        (("--methods", "dillo"), ("dillo", "Did you mean 'dilo'")),
    ],
    ids=" ".join,
)
def test_mistakes_in_a_table_are_one_line(
    options: tuple[str, ...], words: tuple[str, ...], synthetic: Path, lfobench_command: InProcess
) -> None:
    outcome = lfobench_command("table", "--out", synthetic, *options)
    assert_refused(outcome, *words)
    assert outcome.out == ""


@pytest.mark.parametrize(
    ("identity", "words"),
    [
        ({"source": "d4rl"}, ("sources", "d4rl and generated", "--source d4rl or --source generated")),
        ({"simulator": {"gymnasium": "1.4.0", "mujoco": "3.4.0"}}, ("simulator.mujoco = 3.3.7", "3.4.0")),
        (
            {
                "protocol": {
                    "name": "paper",
                    "steps": 20_000,
                    "steps_assigned": False,
                    "evaluation_every": 1000,
                    "evaluation_episodes": 10,
                }
            },
            ("protocols", "paper and quick", "--protocol paper or --protocol quick"),
        ),
    ],
    ids=["source", "simulator", "protocol"],
)
def test_a_table_never_mixes(
    identity: dict[str, Any], words: tuple[str, ...], synthetic: Path, lfobench_command: InProcess
) -> None:
    write_records(synthetic, make_cell([1.0, 2.0], "oril", **identity))
    assert_refused(lfobench_command("table", "--out", synthetic), *words)


def test_a_table_shows_failed_seeds_until_they_have_a_record(synthetic: Path, lfobench_command: InProcess) -> None:
    def dilo() -> tuple[str, str]:
        found = csv.DictReader(io.StringIO(lfobench_command("table", "--out", synthetic, "--format", "csv").out))
        return next((line["seeds"], line["failed_seeds"]) for line in found if line["task"] == "hopper-random-expert")

    assert dilo() == ("0 1 2 3 4", "5")
    shown = lfobench_command("table", "--out", synthetic).out
    assert "!1" in shown
    assert "dilo on hopper-random-expert, seed 5." in " ".join(shown.split())
    write_records(synthetic, [make_record(90.0, seed=5)])
    assert dilo() == ("0 1 2 3 4 5", "")


def test_a_table_names_what_it_skips(synthetic: Path, lfobench_command: InProcess) -> None:
    before = lfobench_command("table", "--out", synthetic, "--format", "csv").out
    (synthetic / "failures" / "stranger.failure").write_text("{}", encoding="utf-8")
    broken = make_record(50.0, seed=9).model_dump(mode="json")
    broken["evaluations"][0]["returns"][0] = float("nan")
    (synthetic / "records" / "nan.json").write_text(json.dumps({**broken, SEAL: "0"}), encoding="utf-8")
    outcome = lfobench_command("table", "--out", synthetic, "--format", "csv")
    assert outcome.code == 0
    assert outcome.out == before
    for name, reason in (("stranger.failure", "no report of a failed run"), ("nan.json", "is not a record")):
        (warning,) = [line for line in outcome.err.splitlines() if name in line]
        assert warning.startswith("Warning: ")
        assert reason in warning


def test_a_table_of_one_seed_says_so(tmp_path: Path, lfobench_command: InProcess) -> None:
    folder = write_records(tmp_path / "one", [make_record(90.0), make_record(5.0, "oril")])
    outcome = lfobench_command("table", "--out", folder)
    assert outcome.code == 0
    said = " ".join(outcome.out.split())
    assert "one seed has no standard deviation and cannot be tested" in said
    assert "Not tested for want of a second seed, both highlighted: every row" in said
    assert "±" not in outcome.out.partition("Score")[0]


def test_a_foreign_file_is_named_and_skipped(compared: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(compared, folder)
    stranger = folder / "records" / "package.json"
    stranger.write_text('{"name": "not ours"}', encoding="utf-8")
    for command in (("table",), ("status",), ("why", *SMOKE)):
        outcome = lfobench_command(*command, "--out", folder)
        assert outcome.code == 0
        assert "Warning" in outcome.err
        assert str(stranger) in outcome.err
    assert json.loads(lfobench_command("status", "--json", "--out", folder).out)["cells"]


def test_a_dry_run_writes_nothing(tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "cache"))
    outcome = lfobench_command("run", *SMOKE, "--out", tmp_path / "runs", "--dry-run")
    assert outcome.code == 0
    assert "12 of 12 runs" in outcome.out
    assert "2 shards" in outcome.out
    assert list(tmp_path.iterdir()) == []


# --- names -----------------------------------------------------------------------------------------------------------


def test_lists(lfobench_command: InProcess) -> None:
    listed = {kind: json.loads(lfobench_command("ls", kind, "--json").out) for kind in ("methods", "suites", "tasks")}
    assert [row["name"] for row in listed["methods"]] == method_names()
    assert "locomotion" in [row["name"] for row in listed["suites"]]
    assert [row["name"] for row in listed["tasks"]] == [task.name for task in load_suite("locomotion").tasks]
    protocols = json.loads(lfobench_command("ls", "protocols", "--json").out)
    assert [row["name"] for row in protocols] == list(PROTOCOLS)
    for kind in ("methods", "suites", "tasks", "protocols"):
        assert lfobench_command("ls", kind).code == 0


@pytest.mark.parametrize("name", [*method_names(), *PROTOCOLS, "locomotion", HOPPER_TASK])
def test_show(name: str, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("show", name, "--protocol", "smoke")
    assert outcome.code == 0
    assert outcome.out.strip()
    assert json.loads(lfobench_command("show", name, "--protocol", "smoke", "--json").out)


def test_show_of_a_method_documents_every_field(lfobench_command: InProcess) -> None:
    text = lfobench_command("show", "dilo").out
    for field, info in type(smoke_cell("dilo").config).model_fields.items():
        assert field in text
        assert info.description
        assert info.description in text


def test_show_of_somebody_elses_method(lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever pydantic allows as a field, and no docstring."""

    class Config(MethodConfig):
        learned: float = ConfigField(description="Has no default.")
        made: tuple[int, ...] = ConfigField(default_factory=lambda: (1, 2), description="Has a factory.")
        bounded: PositiveFloat | None = ConfigField(None, description="An annotated kind, or none.")
        chosen: Literal["this", "that"] = ConfigField("this", description="A [red]choice[/].")

    class Theirs(load_method("bc")):  # type: ignore[misc]
        presets: ClassVar[Any] = {"released": {}}
        budgets: ClassVar[Any] = {}

    Theirs.Config, Theirs.__doc__ = Config, None
    monkeypatch.setattr(registry, "load_method", lambda name: Theirs)
    text = lfobench_command("show", "bc").out
    for words in ("learned (float)", "made (list of int)", "bounded (float or none)", "chosen (this | that): A [red]"):
        assert words in text
    fields = {row["field"]: row for row in json.loads(lfobench_command("show", "bc", "--json").out)["fields"]}
    assert fields["learned"]["released"] == "required"
    assert fields["made"]["released"] == [1, 2]


def test_a_log_gets_lines_with_the_time_left(
    tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "LOG_SECONDS", 0.0)
    outcome = lfobench_command("run", "--methods", "bc", *TINY_SMOKE, "--workers", "1", "--out", tmp_path)
    assert outcome.code == 0
    assert "All runs  0/1  runs done" in outcome.err
    assert re.search(r"bc:released pole-random-expert seed 0  \d+/40  policy.*about \d+ s left", outcome.err)


@pytest.mark.parametrize("size", [10**12, 10**26])
def test_what_the_probe_cannot_run_is_a_warning_and_fails_nothing_else(
    size: int, tmp_path: Path, lfobench_command: InProcess
) -> None:
    run = ("run", "--methods", "dilo,bc", *TINY_SMOKE, "--set", f"dilo.batch_size={size}", "--workers", "1")
    outcome = lfobench_command(*run, "--out", tmp_path)
    assert outcome.code == 1
    assert "Warning: dilo:released pole-random-expert failed in the probe" in outcome.err
    assert "Traceback" not in outcome.err
    assert [record.method for record in RecordFolder(tmp_path).read_all().records] == ["bc"]
    plan = json.loads(lfobench_command(*run, "--out", tmp_path, "--dry-run", "--json").out)
    assert "dilo:released" in plan["warnings"][0]["what"]


def test_a_suite_whose_simulator_does_not_exist(tmp_path: Path, lfobench_command: InProcess) -> None:
    suite = tmp_path / "wrong.py"
    source = Path(TINY).read_text(encoding="utf-8")
    suite.write_text(source.replace("InvertedPendulum-v5", "InvertedPendulumm-v5"), encoding="utf-8")
    chosen = ("--tasks", "pole-random-expert", "--protocol", "smoke", "--workers", "1")
    run = lfobench_command("run", "--methods", "bc", "--suite", suite, *chosen, "--out", tmp_path / "runs")
    assert_refused(run, "pole-random-expert", "no environment 'InvertedPendulumm-v5'", "InvertedPendulum-v5")
    assert_refused(lfobench_command("data", "build", suite, *chosen), "cannot be made", "InvertedPendulumm")


def test_data_that_cannot_be_made_is_one_line_and_nothing_trains(tmp_path: Path, lfobench_command: InProcess) -> None:
    suite = tmp_path / "half.py"
    source = (
        Path(TINY)
        .read_text(encoding="utf-8")
        .replace(
            '        if self.level == "random":',
            '        assert self.level != "medium", "no arm"\n        if self.level == "random":',
        )
    )
    suite.write_text(source, encoding="utf-8")
    run = ("run", "--methods", "bc", "--suite", suite, "--protocol", "smoke", "--seeds", "0", "--workers", "1")
    outcome = lfobench_command(*run, "--out", tmp_path / "runs")
    assert outcome.code == 2
    assert "pole-medium-expert cannot be made: AssertionError: no arm" in outcome.err
    assert lfobench_command(*run, "--out", tmp_path / "runs", "--tasks", "pole-random-expert").code == 0


@pytest.mark.parametrize("error", ["KeyError('no weights')", "SystemExit('no weights')"])
def test_a_demonstrator_that_fails_is_one_line(error: str, tmp_path: Path, lfobench_command: InProcess) -> None:
    suite = tmp_path / "wrong.py"
    source = Path(TINY).read_text(encoding="utf-8").replace("    return Pole(level)", f"    raise {error}")
    suite.write_text(source, encoding="utf-8")
    outcome = lfobench_command(
        "run", "--methods", "bc", "--suite", suite, "--protocol", "smoke", "--out", tmp_path / "o"
    )
    assert_refused(outcome, "demonstrator of pole failed", error.partition("(")[0], "no weights")


def test_records_that_contradict_each_other_stop_a_run(tmp_path: Path, lfobench_command: InProcess) -> None:
    run = ("run", "--methods", "bc", *TINY_SMOKE, "--workers", "1", "--out", tmp_path)
    assert lfobench_command(*run).code == 0
    (path,) = tmp_path.rglob("*.json")
    content = json.loads(path.read_text(encoding="utf-8"))
    del content[SEAL]
    content["metrics"] = []
    copy = tmp_path / "merged.json"
    copy.write_text(json.dumps({**content, SEAL: content_hash(content)}), encoding="utf-8")
    outcome = lfobench_command(*run)
    assert outcome.code == 2
    error = outcome.err.splitlines()[-1]
    assert error.startswith("Error: bc:released pole-random-expert seed 0 has records that contradict each other")
    assert str(path) in error
    assert str(copy) in error


def test_an_edited_record_is_named_before_its_run_is_repeated(tmp_path: Path, lfobench_command: InProcess) -> None:
    run = ("run", "--methods", "bc", *TINY_SMOKE, "--workers", "1", "--out", tmp_path)
    assert lfobench_command(*run).code == 0
    (path,) = tmp_path.rglob("*.json")
    path.write_text(path.read_text(encoding="utf-8").replace('"finished"', '"diverged"'), encoding="utf-8")
    outcome = lfobench_command(*run)
    assert outcome.code == 0
    assert "edited after it was written" in outcome.err
    assert RecordFolder(tmp_path).read_all().warnings == []


def test_assigned_steps_are_in_the_plan_and_the_record(tmp_path: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command(
        "run", "--methods", "bc", *TINY_SMOKE, "--steps", "25", "--workers", "1", "--out", tmp_path
    )
    assert outcome.code == 0
    assert "25, set with --steps" in outcome.out
    (record,) = RecordFolder(tmp_path).read_all().records
    assert [evaluation.step for evaluation in record.evaluations] == [10, 20, 25]


def test_assigned_evaluations_are_in_the_plan_and_the_record(tmp_path: Path, lfobench_command: InProcess) -> None:
    asked = ("--evaluation-every", "20", "--evaluation-episodes", "3", "--final-episodes", "4")
    common = ("--methods", "bc", *TINY_SMOKE, "--seeds", "0", "--workers", "1", "--out", tmp_path)
    outcome = lfobench_command("run", *common, *asked)
    assert outcome.code == 0
    assert all(f"set with {flag}" in outcome.out for flag in asked[::2])
    (record,) = RecordFolder(tmp_path).read_all().records
    assert [(evaluation.step, len(evaluation.returns)) for evaluation in record.evaluations] == [(20, 3), (40, 3)]
    assert record.further is not None and len(record.further.returns) == 4
    assert lfobench_command("why", *common[:-4], "--out", tmp_path, *asked).out.count("reused") == 1
    assert lfobench_command("run", *common, "--evaluation-episodes", "0").code == 2


def test_a_suite_by_path(tmp_path: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("run", "--methods", "bc", *TINY_SMOKE, "--workers", "1", "--out", tmp_path / "runs")
    assert outcome.code == 0
    rows = json.loads(lfobench_command("ls", "tasks", "--suite", TINY, "--json").out)
    assert [row["name"] for row in rows] == ["pole-random-expert", "pole-medium-expert"]
    for suite in (TINY, "tiny"):
        table = lfobench_command("table", "--out", tmp_path / "runs", "--format", "csv", "--suite", suite)
        assert table.code == 0
        assert "pole-random-expert" in table.out


def test_data_status_and_build(tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "cache"))
    chosen = (TINY, "--protocol", "smoke", "--tasks", "pole-random-expert")
    before = json.loads(lfobench_command("data", "status", *chosen, "--json").out)
    assert [(row["shards"], row["shards_present"]) for row in before] == [(1, 0), (1, 0)]
    assert not (tmp_path / "cache").exists()
    assert lfobench_command("data", "build", *chosen, "--workers", "1").code == 0
    after = json.loads(lfobench_command("data", "status", *chosen, "--json").out)
    assert [row["shards_present"] for row in after] == [1, 1]
    again = lfobench_command("data", "build", *chosen)
    assert again.code == 0
    assert "Nothing to build" in again.out


def command_paths() -> list[tuple[str, ...]]:
    from typer.main import get_command

    found: list[tuple[str, ...]] = []

    def descend(command: Any, path: tuple[str, ...]) -> None:
        if subcommands := getattr(command, "commands", None):
            for name, subcommand in subcommands.items():
                descend(subcommand, (*path, name))
        else:
            found.append(path)

    descend(get_command(app), ())
    return found


@pytest.mark.parametrize("path", command_paths(), ids=" ".join)
def test_every_command_has_an_example(path: tuple[str, ...], lfobench_command: InProcess) -> None:
    outcome = lfobench_command(*path, "--help")
    assert outcome.code == 0
    assert "Example: lfobench" in outcome.out


def test_help_lists_every_command(lfobench_command: InProcess) -> None:
    text = lfobench_command("--help").out
    assert {path[0] for path in command_paths()} == {"ls", "show", "data", "run", "status", "why", "table"} | {
        "plot",
        "compare",
        "audit",
        "check",
        "new",
        "power",
        "report",
        "tune",
        "video",
    }
    for path in command_paths():
        assert path[0] in text


# --- mistakes --------------------------------------------------------------------------------------------------------

MISTAKES: list[tuple[tuple[str, ...], tuple[str, ...]]] = [
    (("--methods", "dillo"), ("dillo", "Did you mean 'dilo'")),
    (("--suite", "locomotoin"), ("locomotoin", "Did you mean 'locomotion'")),
    (("--suite", "absent.py"), ("absent.py",)),
    (("--tasks", "hopper-random-exprt"), ("hopper-random-exprt", "Did you mean 'hopper-random-expert'")),
    (("--protocol", "quik"), ("quik", "Did you mean 'quick'")),
    (("--preset", "relesed"), ("relesed", "Did you mean 'released'")),
    (("--source", "d4lr"), ("d4lr", "Did you mean 'd4rl'")),
    (("--device", "gpu"), ("gpu",)),
    (("--seeds", "7-3"), ("7-3", "--seeds 0-6")),
    (("--seeds", "many"), ("many", "--seeds 0-6")),
    (("--set", "dilo.tua=3"), ("tua", "Did you mean 'tau'")),
    (("--set", "dilo.tau=warm"), ("dilo.tau", "warm", "number")),
    (("--set", "dilo.tau=Infinity"), ("dilo.tau",)),
    (("--set", "dilo.hidden=[0]"), ("dilo.hidden",)),
    (("--set", "dilo.batch_size=true"), ("dilo.batch_size",)),
    (("--set", "tau=3"), ("tau=3", "METHOD.FIELD=VALUE")),
    (("--set", "bc.tau=3"), ("bc",)),
]


@pytest.mark.parametrize(("options", "words"), MISTAKES, ids=lambda value: " ".join(value) if value else "")
@pytest.mark.parametrize("command", ["run", "why"])
def test_a_mistake_is_one_line_and_writes_nothing(
    command: str,
    options: tuple[str, ...],
    words: tuple[str, ...],
    tmp_path: Path,
    lfobench_command: InProcess,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "cache"))
    given = {"--methods": "dilo", "--tasks": HOPPER_TASK, "--protocol": "smoke", "--seeds": "0"}
    if options[0] == "--suite":
        given.pop("--tasks")
    given |= {options[0]: options[1]}
    outcome = lfobench_command(command, *(part for pair in given.items() for part in pair), "--out", tmp_path / "runs")
    assert_refused(outcome, *words)
    assert outcome.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("show", "dillo"), ("dillo", "Did you mean 'dilo'")),
        (("show", "dilo", "--suite", "locomotoin"), ("locomotoin", "locomotion")),
        (("show", HOPPER_TASK, "--protocol", "quik"), ("quik", "quick")),
        (("ls", "tasks", "--suite", "locomotoin"), ("locomotoin", "locomotion")),
        (("data", "status", "locomotoin"), ("locomotoin", "locomotion")),
        (("data", "status", "locomotion", "--tasks", "nope"), ("nope",)),
        (("data", "build", "locomotion", "--tasks", HOPPER_TASK, "--protocol", "quik"), ("quik", "quick")),
        (("table", "--out", "/nowhere/at/all"), ("/nowhere/at/all", "lfobench run")),
        (("status", "--out", "/nowhere/at/all"), ("/nowhere/at/all", "lfobench run")),
    ],
)
def test_mistakes_in_other_commands(
    arguments: tuple[str, ...], words: tuple[str, ...], lfobench_command: InProcess
) -> None:
    assert_refused(lfobench_command(*arguments), *words)


@pytest.mark.parametrize("option", ["--suite", "--protocol", "--steps", "--preset", "--source", "--methods"])
def test_a_filter_that_leaves_no_record_says_so(option: str, compared: Path, lfobench_command: InProcess) -> None:
    """The folder is full of records: 'run first' would be the wrong way out."""
    outcome = lfobench_command("table", "--out", compared, option, "41" if option == "--steps" else "nonesuch")
    assert_refused(outcome)
    assert "lfobench run" not in outcome.err


@pytest.mark.parametrize(
    "command", [("ls", "nonsense"), ("run", "--workers", "0"), ("runn",), ("table", "--alpha", "2")]
)
def test_usage_mistakes(command: tuple[str, ...], lfobench_command: InProcess) -> None:
    outcome = lfobench_command(*command)
    assert outcome.code == 2
    assert "Traceback" not in outcome.err


def test_an_output_folder_that_cannot_be_written(tmp_path: Path, lfobench_command: InProcess) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    out = tmp_path / "file" / "runs"
    outcome = lfobench_command("run", "--methods", "bc", *TINY_SMOKE, "--workers", "1", "--out", out)
    assert_refused(outcome, str(out), "--out")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("command", [("run", "--methods", "bc", *TINY_SMOKE), ("data", "build", TINY)])
def test_a_cache_that_cannot_be_written(
    command: tuple[str, ...], tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "file" / "cache"))
    out = ("--out", str(tmp_path / "runs")) if command[0] == "run" else ("--protocol", "smoke")
    outcome = lfobench_command(*command, "--workers", "1", *out)
    assert_refused(outcome, str(tmp_path / "file" / "cache"))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("damage", ["truncated", "altered"])
def test_a_damaged_cache(
    damage: str, tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line, exit code 2, nothing written; the line's own commands mend it."""
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "cache"))
    chosen = ("--suite", TINY, "--tasks", "pole-random-expert", "--protocol", "smoke")
    assert lfobench_command("data", "build", TINY, *chosen[2:], "--workers", "1").code == 0
    shard = next((tmp_path / "cache").rglob("*-random-*/*.safetensors"))
    content, arrays = shard.read_bytes(), load_file(shard)
    shard.write_bytes(content[:-64] if damage == "truncated" else content[:-64] + bytes(64))
    command = ("run", "--methods", "bc,dilo", *chosen, "--seeds", "0", "--workers", "1", "--out", tmp_path / "runs")
    outcome = lfobench_command(*command)
    assert_refused(outcome, str(shard))
    assert not (tmp_path / "runs").exists()
    printed = re.search(r"rm (?P<file>.*) && lfobench (?P<rebuild>.*)$", outcome.err.strip())
    assert printed
    Path(*shlex.split(printed["file"])).unlink()
    assert lfobench_command(*shlex.split(printed["rebuild"]), "--workers", "1").code == 0
    rebuilt = load_file(shard)
    assert all(np.array_equal(rebuilt[name], arrays[name]) for name in arrays), "rebuilt as it was"
