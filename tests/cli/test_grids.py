"""Grids that are no suite's: given with `--grid`, or a method's own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers_cli import InProcess, assert_refused
from helpers_engine import POLE_TASK, TINY
from helpers_plugins import method_source, records_in

import lfobench
from lfobench.errors import UserError

ON_POLE = ("--suite", TINY, "--tasks", POLE_TASK, "--protocol", "smoke")


RUN = ("run", "--methods", "bc", *ON_POLE, "--seeds", "0-1", "--workers", "1")
TUNE = ("tune", *ON_POLE, "--workers", "1", "--starts", "2")


@pytest.fixture(autouse=True)
def hasty_probe(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a plan takes is not asked here."""
    monkeypatch.setattr("lfobench.engine.probe.PROBE_SECONDS", 1e-9)


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A method's file whose constants are its neighbour's."""
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "rates.py").write_text("RATE = 0.1\n", encoding="utf-8")
    path = folder / "file_of_mine.py"
    path.write_text(method_source().replace("0.1 *", "RATE *") + "\nfrom rates import RATE\n", encoding="utf-8")
    return path


def test_any_method_is_tuned_on_any_suite(mine: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    """By path, on a suite without a grid; the choice is found again without saying the grid once more."""
    out = tmp_path / "runs"
    grid = ("--grid", "mine.beta=0.5,1")
    outcome = lfobench_command(*TUNE, "--methods", mine, *grid, "--out", out, "--json")
    assert outcome.code == 0, outcome
    (choice,) = json.loads(outcome.out)
    assert choice["tuning"]["grid"] == {"beta": [0.5, 1.0]}
    assert len(choice["trials"]) == 2
    run = ("run", "--methods", mine, *ON_POLE, "--seeds", "0", "--workers", "1", "--out", out, "--tuned")
    assert lfobench_command(*run).code == 0
    (record,) = records_in(out)
    assert record.tuning is not None and record.tuning.grid == {"beta": [0.5, 1.0]}
    assert record.identity["tuned"] == choice["tuning"]["chosen"]
    planned = lfobench_command(*run, *grid, "--dry-run", "--json")
    assert [each["done"] for each in json.loads(planned.out)["runs"]] == [True]
    (mine.parent / "rates.py").write_text("RATE = 0.3\n", encoding="utf-8")
    assert_refused(lfobench_command(*run), "declares a grid", "lfobench tune --grid")
    assert_refused(lfobench_command(*run, *grid), "made under other conditions", "method_code.rates.py", "--grid")


def test_fields_of_a_grid_multiply_and_several_choices_are_told_apart(
    tmp_path: Path, lfobench_command: InProcess
) -> None:
    out = tmp_path / "runs"
    both = ("--grid", "bc.learning_rate=0.01,0.1", "--grid", "bc.hidden=[8],[4,4]")
    (choice,) = json.loads(lfobench_command(*TUNE, *both, "--out", out, "--json").out)
    assert [trial["values"] for trial in choice["trials"]] == [
        {"learning_rate": rate, "hidden": widths} for rate in (0.01, 0.1) for widths in ([8], [4, 4])
    ]
    assert lfobench_command(*TUNE, "--grid", "bc.loss=squared,likelihood", "--out", out).code == 0
    run = ("run", "--methods", "bc", *ON_POLE, "--seeds", "0", "--out", out, "--dry-run", "--json", "--tuned")
    refused = lfobench_command(*run)
    assert_refused(refused, "2 choices for bc", "--grid bc.loss=squared,likelihood", "--grid bc.hidden=[8],[4, 4]")
    for grid, fields in ((both, {"learning_rate", "hidden"}), (("--grid", "bc.loss=squared,likelihood"), {"loss"})):
        (planned,) = json.loads(lfobench_command(*run, *grid).out)["runs"]
        assert set(planned["tuned"]) == fields
    tuned = {"suite": TINY, "tasks": POLE_TASK, "protocol": "smoke", "seeds": [0], "out": out, "tuned": True}
    with pytest.raises(UserError, match="2 choices for bc"):
        lfobench.run("bc", **tuned)
    left = lfobench.run("bc", **tuned, grid={"bc.loss": ["squared", "likelihood"]})
    assert [set(record.identity["tuned"]) for record in left.records] == [{"loss"}]


def test_a_method_s_own_grid_gives_way_to_the_suite_s(tmp_path: Path, lfobench_command: InProcess) -> None:
    path = tmp_path / "graded.py"
    source = method_source().replace('    name = "mine"\n', '    name = "mine"\n    grids = {"beta": (0.25, 0.5)}\n')
    path.write_text(source, encoding="utf-8")
    outcome = lfobench_command(*TUNE, "--methods", path, "--out", tmp_path / "runs", "--json")
    assert json.loads(outcome.out)[0]["tuning"]["grid"] == {"beta": [0.25, 0.5]}
    suite = tmp_path / "graded_suite.py"
    text = Path(TINY).read_text(encoding="utf-8")
    suite.write_text(text.replace("paper_steps=100,", 'paper_steps=100, grids={"mine": {"beta": (2, 3)}},'), "utf-8")
    tune = ("tune", "--suite", suite, *TUNE[3:], "--methods", path, "--out", tmp_path / "runs", "--json")
    assert json.loads(lfobench_command(*tune).out)[0]["tuning"]["grid"] == {"beta": [2.0, 3.0]}


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ((*TUNE, "--grid", "bc.learning_rate"), ("is not METHOD.FIELD=V1,V2",)),
        ((*TUNE, "--grid", "bc.learning_rate="), ("is not METHOD.FIELD=V1,V2",)),
        ((*TUNE, "--grid", "bc.rate=1,2"), ("--grid: the grid of bc has the field 'rate', which bc lacks",)),
        ((*TUNE, "--grid", "bc.batch_size=8,8.0"), ("--grid: the grid of bc has a value of batch_size twice",)),
        ((*TUNE, "--grid", "bc.batch_size=8,many"), ("batch_size = 'many'",)),
        ((*TUNE, "--grid", "bc.batch_size=8", "--grid", "bc.batch_size=9"), ("names bc.batch_size twice",)),
        ((*TUNE, "--methods", "bc", "--grid", "bcc.batch_size=8"), ("Unknown method in --grid 'bcc'",)),
        ((*TUNE, "--methods", "bc,dilo", "--grid", "bc.batch_size=8"), ("no grid for dilo", "--grid dilo.FIELD=V1,V2")),
        ((*RUN, "--grid", "bc.batch_size=8"), ("--grid says which choice --tuned takes",)),
        ((*RUN, "--tuned", "--grid", "bc.batch_size=8,9"), ("no choice for bc", "--grid bc.batch_size=8,9")),
    ],
)
def test_mistaken_grids_are_one_line(
    command: tuple[str, ...], words: tuple[str, ...], tmp_path: Path, lfobench_command: InProcess
) -> None:
    assert_refused(lfobench_command(*command, "--out", tmp_path / "runs"), *words)
