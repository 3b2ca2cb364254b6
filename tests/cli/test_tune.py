"""``lfobench tune`` and ``run --tuned``, typed: from a grid to records that say what their values cost."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers_cli import InProcess, assert_refused
from helpers_engine import StopAfter

from lfobench.cli.console import INTERRUPTED
from lfobench.contract.suite import Task
from lfobench.engine import evaluation
from lfobench.files import locked
from lfobench.record import Record
from lfobench.records.folder import RecordFolder, read_record
from lfobench.registry import load_suite, suite_names
from lfobench.schedule import execution
from methods.bco import Bco

TUNED = str(Path(__file__).parents[1] / "tuned_suite.py")
TASK = "pole-random-expert"
ON_POLE = ("--suite", TUNED, "--tasks", TASK, "--protocol", "smoke", "--workers", "1")
TUNE = ("tune", *ON_POLE, "--starts", "3")
RUN = ("run", "--methods", "bc,dilo", *ON_POLE, "--seeds", "0")


@pytest.fixture(autouse=True)
def hasty_probe(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a plan takes is not asked here."""
    monkeypatch.setattr("lfobench.engine.probe.PROBE_SECONDS", 1e-9)


@pytest.fixture
def tuned(shared_cache: Path, lfobench_command: InProcess) -> Path:
    """An output folder in which everything is tuned, made by the first test that asks; read-only."""
    made = shared_cache.parent / "tuned"
    with locked(shared_cache.parent / "tuned.lock", "--out", wait=True):
        if not made.exists():
            making = shared_cache.parent / "tuned-in-the-making"
            outcome = lfobench_command(*TUNE, "--out", making)
            assert outcome.code == 0, outcome
            made.with_suffix(".printed").write_text(outcome.out, encoding="utf-8")
            making.rename(made)
    return made


@pytest.fixture
def folder(tuned: Path, tmp_path: Path) -> Path:
    """A copy of it, to write into."""
    return Path(shutil.copytree(tuned, tmp_path / "runs"))


def trial_files(out: Path) -> list[Path]:
    return sorted((out / "tuning" / "records").rglob("*.json"))


def trials(out: Path) -> list[Record]:
    found = [read_record(path) for path in trial_files(out)]
    assert all(isinstance(record, Record) for record in found), found
    return [record for record in found if isinstance(record, Record)]


def choices(out: Path) -> dict[str, Any]:
    """By method."""
    found = [json.loads(path.read_text("utf-8")) for path in sorted((out / "tuning" / TASK).iterdir())]
    return {choice["conditions"]["method"]: choice for choice in found}


# --- tuning ----------------------------------------------------------------------------------------------------------


def test_every_combination_leaves_a_trial_and_every_grid_a_choice(tuned: Path) -> None:
    found = trials(tuned)
    assert sorted((record.method, *record.identity["tuned"].values(), record.seed) for record in found) == [
        ("bc", 0.01, 1000),
        ("bc", 1.0, 1000),
        ("bco", 1, 1000),
        ("bco", 2, 1000),
    ]
    for record in found:
        (only,) = record.evaluations
        assert (only.step, len(only.returns)) == (40, 3)
        assert record.tuning is None
    assert set(choices(tuned)) == {"bc", "bco"}
    assert not (tuned / "records").exists()
    assert {path.suffix for path in (tuned / "tuning").rglob("*") if path.is_file()} <= {".json", ".safetensors"}


def test_the_choice_is_the_best_of_the_trials(tuned: Path) -> None:
    for method, choice in choices(tuned).items():
        field, values = next(iter(choice["tuning"]["grid"].items()))
        scores = {
            record.identity["tuned"][field]: sum(record.evaluations[0].returns) / 3
            for record in trials(tuned)
            if record.method == method
        }
        # bco's two trials tie; its untuned value is the smoke protocol's.
        untuned = Bco.budgets["smoke"].get(field)
        assert choice["tuning"]["chosen"] == {field: max(values, key=lambda value: (scores[value], value == untuned))}
        assert [each["scores"] for each in choice["trials"]] == [
            pytest.approx([100 * (scores[value] - 5.0) / 55.0]) for value in values
        ]


def test_the_budget_counts_every_stage_of_every_trial(tuned: Path) -> None:
    """Two trainings of 40 steps; bco's have a stage before that, of which two trials make one and two epochs."""
    found = choices(tuned)
    assert (found["bc"]["tuning"]["runs"], found["bc"]["tuning"]["steps"]) == (2, 80)
    one_epoch = (found["bco"]["tuning"]["steps"] - 80) // 3
    epochs = {
        record.identity["tuned"]["inverse_dynamics_epochs"]: record.metrics[0].step
        for record in trials(tuned)
        if record.method == "bco"
    }
    assert epochs == {1: one_epoch, 2: 2 * one_epoch}
    assert one_epoch > 2000 / 32


def test_what_is_printed(tuned: Path) -> None:
    printed = tuned.with_suffix(".printed").read_text(encoding="utf-8")
    rows = [
        line.split("│")[3].strip() for line in printed.splitlines() if line.startswith("│") and line.count("│") == 6
    ]
    chosen = "".join(rows).replace(" ", "")
    assert "4 of 4 runs" in printed
    for method, choice in choices(tuned).items():
        ((field, value),) = choice["tuning"]["chosen"].items()
        assert method in printed and f"{field}={value}" in chosen
    assert "mean score of the last evaluation over 3 validation starts" in printed


def test_trials_start_where_no_test_does(
    tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    used: set[tuple[str, int]] = set()
    start_seed: Callable[..., int] = evaluation.start_seed

    def noted(task: Task, episode: int, starts: Any = "evaluation") -> int:
        used.add((starts, start_seed(task, episode, starts)))
        return start_seed(task, episode, starts)

    monkeypatch.setattr(evaluation, "start_seed", noted)
    (task, _) = load_suite(TUNED).tasks
    assert lfobench_command(*TUNE, "--methods", "bc", "--out", tmp_path).code == 0
    assert used == {("validation", start_seed(task, episode, "validation")) for episode in range(3)}
    used.clear()
    assert lfobench_command(*RUN, "--tuned", "--out", tmp_path).code == 0
    assert used == {("evaluation", start_seed(task, episode)) for episode in range(2)}


def test_validation_starts_are_no_test_starts_of_any_suite() -> None:
    for name in suite_names():
        for task in load_suite(name).tasks:
            tests = {evaluation.start_seed(task, episode) for episode in range(1000)}
            assert tests.isdisjoint(evaluation.start_seed(task, episode, "validation") for episode in range(1000))


# --- resuming --------------------------------------------------------------------------------------------------------


def test_the_same_command_redoes_nothing(folder: Path, lfobench_command: InProcess) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    outcome = lfobench_command(*TUNE, "--out", folder)
    assert outcome.code == 0
    assert "nothing: all 4 runs are done" in outcome.out
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()} == before


def test_a_stopped_search_goes_on_where_it_stood(
    tuned: Path, tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = StopAfter(60)
    with monkeypatch.context() as patch:
        patch.setattr(execution.StopRequest, "__call__", lambda _: stop())
        stopped = lfobench_command(*TUNE, "--methods", "bc", "--out", tmp_path)
    assert stopped.code == INTERRUPTED
    assert len(trial_files(tmp_path)) == 1
    assert list((tmp_path / "tuning" / "checkpoints").glob("*.safetensors"))
    assert not (tmp_path / "tuning" / TASK).exists(), "nothing is chosen from half of the trials"
    plan = json.loads(lfobench_command(*TUNE, "--methods", "bc", "--out", tmp_path, "--dry-run", "--json").out)
    assert [run["done"] for run in plan["runs"]] == [True, False]
    assert lfobench_command(*TUNE, "--methods", "bc", "--out", tmp_path).code == 0
    assert choices(tmp_path)["bc"] == choices(tuned)["bc"]
    straight = [record.measured() for record in trials(tuned) if record.method == "bc"]
    assert [record.measured() for record in trials(tmp_path)] == straight


def test_a_lost_trial_or_choice_is_made_again(folder: Path, tuned: Path, lfobench_command: InProcess) -> None:
    lost, *kept = trial_files(folder)
    stamps = [path.stat().st_mtime_ns for path in kept]
    lost.unlink()
    shutil.rmtree(folder / "tuning" / TASK)
    assert lfobench_command(*TUNE, "--out", folder).code == 0
    assert [path.stat().st_mtime_ns for path in kept] == stamps
    assert choices(folder) == choices(tuned)


def test_a_trial_that_fails_leaves_its_grid_undecided_and_the_others_decided(
    tmp_path: Path, lfobench_command: InProcess
) -> None:
    outcome = lfobench_command(*TUNE, "--set", f"bco.batch_size={10**12}", "--out", tmp_path)
    assert outcome.code == 1
    assert "2 failed" in outcome.err
    assert set(choices(tmp_path)) == {"bc"}
    assert_refused(
        lfobench_command("run", "--methods", "bco", *ON_POLE, "--tuned", "--out", tmp_path),
        "There is no choice for bco",
    )


def test_other_seeds_and_starts_take_the_place_of_the_choice(folder: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command(*TUNE[:-1], "2", "--methods", "bc", "--seeds", "7-8", "--out", folder, "--json")
    assert outcome.code == 0
    (choice,) = json.loads(outcome.out)
    assert (choice["task"], choice["method"]) == (TASK, "bc")
    assert choice["tuning"]["runs"] == 2 + 4, "the earlier search's trials are paid for too"
    assert choice["tuning"]["criterion"] == "mean score of the last evaluation over 2 validation starts and 2 seeds"
    assert [len(trial["scores"]) for trial in choice["trials"]] == [2, 2]
    assert choices(folder)["bc"]["seeds"] == [7, 8]
    assert json.loads(Path(choice["file"]).read_text("utf-8"))["tuning"] == choice["tuning"]


def test_a_dry_run_writes_nothing(tmp_path: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command(*TUNE, "--out", tmp_path / "runs", "--dry-run")
    assert outcome.code == 0
    assert "4 of 4 runs" in outcome.out
    assert list(tmp_path.iterdir()) == []


# --- run --tuned -----------------------------------------------------------------------------------------------------


def test_a_tuned_run_has_the_values_and_says_what_they_cost(folder: Path, lfobench_command: InProcess) -> None:
    choice = choices(folder)["bc"]["tuning"]
    outcome = lfobench_command(*RUN, "--tuned", "--out", folder)
    assert outcome.code == 0
    assert "1 of 2 cells, as 'lfobench tune' chose" in outcome.out
    read = RecordFolder(folder).read_all()
    assert read.warnings == []
    records = {record.method: record for record in read.records}
    assert set(records) == {"bc", "dilo"}
    bc = records["bc"]
    assert bc.tuning is not None
    assert bc.tuning.model_dump(mode="json") == choice
    assert bc.identity["tuned"] == choice["chosen"]
    assert bc.identity["config"]["learning_rate"] == choice["chosen"]["learning_rate"]
    assert bc.identity["config"]["batch_size"] == 24
    assert bc.identity["set"] == {}
    assert "learning_rate" not in bc.identity["overrides"]
    assert [len(each.returns) for each in bc.evaluations] == [2] * 4, "evaluated as any result is"
    assert records["dilo"].tuning is None
    assert {"tuned", "starts"}.isdisjoint(records["dilo"].identity)

    again = json.loads(lfobench_command(*RUN, "--tuned", "--out", folder, "--dry-run", "--json").out)
    assert all(run["done"] for run in again["runs"])
    assert [run["tuned"] for run in again["runs"]] == [choice["chosen"], {}]
    explained = json.loads(lfobench_command("why", *RUN[1:-4], *RUN[-2:], "--tuned", "--out", folder, "--json").out)
    assert all(answer["reused"] for answer in explained)
    bc_alone = ("why", "--methods", "bc", *ON_POLE[:-2], "--seeds", "0", "--out", folder)
    untuned = lfobench_command(*bc_alone, "--json")
    (answer,) = json.loads(untuned.out)
    assert not answer["reused"]
    assert f"tuned: {json.dumps(choice['chosen'], separators=(',', ':'))} -> absent" in answer["differences"]

    status = json.loads(lfobench_command("status", "--out", folder, "--json").out)
    assert {cell["method"]: cell["preset"] for cell in status["cells"]} == {
        "bc": f"released, tuned learning_rate={choice['chosen']['learning_rate']}",
        "dilo": "released",
    }
    assert status["runs_in_progress"] == 0


def test_what_is_set_stays_over_what_was_chosen(folder: Path, lfobench_command: InProcess) -> None:
    run = (*RUN, "--tuned", "--set", "bc.learning_rate=0.125", "--out", folder, "--dry-run", "--json")
    found = json.loads(lfobench_command(*run).out)["runs"]
    assert {each["method"]: each["tuned"] for each in found} == {"bc": {}, "dilo": {}}


def test_before_tuning_the_command_to_run_is_named(tmp_path: Path, lfobench_command: InProcess) -> None:
    out = tmp_path / "runs"
    outcome = lfobench_command(*RUN, "--tuned", "--out", out)
    assert_refused(outcome, f"no choice for bc on {TASK}", f"lfobench tune --methods bc --suite {TUNED} --tasks {TASK}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("--steps", "30"), "protocol.steps: 40 -> 30"),
        (("--preset", "paper"), 'preset: "released" -> "paper"'),
        (("--set", "bc.batch_size=16"), "config.batch_size: 24 -> 16"),
    ],
    ids=["steps", "preset", "set"],
)
def test_a_choice_made_under_other_conditions_is_not_taken(
    options: tuple[str, str], what: str, tuned: Path, lfobench_command: InProcess
) -> None:
    outcome = lfobench_command(*RUN, *options, "--tuned", "--out", tuned)
    assert_refused(
        outcome, f"bc on {TASK}", "other conditions", what, "Run first: lfobench tune --methods bc", options[0]
    )


# --- mistakes and names ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("tune", *ON_POLE, "--methods", "dilo"), ("no grid for dilo", "with a grid: bc, bco")),
        (("tune", *ON_POLE, "--methods", "bcc"), ("Unknown method 'bcc'", "Did you mean 'bc'")),
        (("tune", *ON_POLE, "--preset", "papper"), ("Unknown preset", "'papper'")),
        (("tune", "--suite", "locomotion", "--tasks", "hopper-*"), ("'locomotion' declares no grid for these tasks",)),
        (("tune", "--suite", "locomotoin"), ("Unknown suite 'locomotoin'",)),
        (("tune", *ON_POLE, "--set", "bc.learning_rate=1"), ("--set bc.learning_rate", "Leave it out")),
        (("tune", *ON_POLE, "--seeds", "many"), ("'many' is not a list of seeds",)),
        (("run", "--methods", "dilo", *ON_POLE, "--tuned"), ("declares a grid", "Leave out --tuned")),
    ],
    ids=lambda value: " ".join(value[-2:]),
)
def test_mistakes_are_one_line(
    command: tuple[str, ...], words: tuple[str, ...], tmp_path: Path, lfobench_command: InProcess
) -> None:
    assert_refused(lfobench_command(*command, "--out", tmp_path / "runs"), *words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("starts", ["0", "-3", "few"])
def test_there_is_at_least_one_start(starts: str, tmp_path: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("tune", *ON_POLE, "--starts", starts, "--out", tmp_path / "runs")
    assert outcome.code == 2
    assert "--starts" in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_a_suites_mistake_is_told(tmp_path: Path, lfobench_command: InProcess) -> None:
    suite = tmp_path / "mistaken.py"
    text = Path(TUNED).read_text(encoding="utf-8")
    text = text.replace('Path(__file__).with_name("tiny_suite.py")', repr(str(Path(TUNED).with_name("tiny_suite.py"))))
    suite.write_text(text.replace('"learning_rate": (0.01, 1)', '"learning_rat": (0.01, 1)'), encoding="utf-8")
    outcome = lfobench_command(
        "tune", "--suite", suite, "--tasks", TASK, "--protocol", "smoke", "--out", tmp_path / "runs"
    )
    assert_refused(outcome, f"Suite 'tuned', task '{TASK}'", "'learning_rat', which bc lacks", "'learning_rate'")


def test_show_prints_the_grid(lfobench_command: InProcess) -> None:
    text = lfobench_command("show", TASK, "--suite", TUNED, "--protocol", "smoke").out
    assert "grid of bc: learning_rate 0.01, 1" in text
    assert "grid of bco: inverse_dynamics_epochs 2, 1" in text
