"""``lfobench plot SUITE`` and its mistakes, on runs of a few steps."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import scene_suite
from helpers_cli import InProcess, assert_refused
from helpers_engine import finish, make_job, smoke_cell

from lfobench.engine.trained import traces_of
from lfobench.records.folder import RecordFolder

SUITE = str(Path(scene_suite.__file__))
TASKS = ("reach-few", "reach-uniform", "strike-few")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory, shared_cache: Path) -> Path:
    """Two seeds of behaviour cloning on three tasks."""
    out = tmp_path_factory.mktemp("scene") / "runs"
    for task in TASKS:
        finish(make_job(smoke_cell("bc", task, SUITE), (0, 1), out, shared_cache))
    return out


def test_paths_show_demonstrations_beside_the_episodes(tmp_path: Path, lfobench_command: InProcess, runs: Path) -> None:
    to = tmp_path / "new" / "paths.svg"
    done = lfobench_command("plot", SUITE, "--tasks", "reach-*", "--out", runs, "--to", to, "--seed", 1)
    assert done.code == 0, done
    assert done.out.startswith("Paths of the end-effector from above")
    assert done.out.count("\n") == 1
    assert "seed 1" in done.out
    drawn = to.read_text(encoding="utf-8")
    for title in ("reach-few", "reach-uniform", "demonstrations", "cup", "bowl"):
        assert title in drawn
    assert "strike" not in drawn
    # The smoke protocol evaluates from two starts.
    assert len(re.findall(r"\d/2<", drawn)) == 2
    assert list(to.parent.iterdir()) == [to]


@pytest.mark.parametrize(
    ("view", "shown", "words"),
    [
        ("field", ("reach-few bc", "reach-uniform bc"), "Field of actions from above"),
        ("hitting", ("bc, start 1:", "bc, start 3:"), "shaded by time"),
    ],
)
def test_a_view_shows_the_tasks_that_it_can(
    tmp_path: Path, lfobench_command: InProcess, runs: Path, view: str, shown: tuple[str, ...], words: str
) -> None:
    to = tmp_path / "figure.svg"
    starts = ("--episodes", "1,3") if view == "hitting" else ()
    done = lfobench_command("plot", SUITE, "--view", view, "--out", runs, "--to", to, "--width", "page", *starts)
    assert done.code == 0, done
    assert words in done.out
    drawn = to.read_text(encoding="utf-8")
    assert all(title in drawn for title in shown)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((SUITE, "--view", "path"), ("Did you mean 'paths'",)),
        ((SUITE, "--seed", 7), ("seed 7", "0, 1")),
        ((SUITE, "--tasks", "reach-fwe"), ("Did you mean 'reach-few'",)),
        ((SUITE, "--tasks", "alone-few"), ("no runs",)),
        ((SUITE, "--methods", "dilo"), ("dilo", "bc")),
        ((SUITE, "--episodes", "1-x"), ("'1-x'", "0-3")),
        ((SUITE, "--episodes", "0-100"), ("101",)),
        ((SUITE, "--view", "field", "--episodes", "0"), ("--episodes",)),
        ((SUITE, "--view", "field", "--tasks", "strike-few"), ("strike-few", "no field")),
        ((SUITE, "--view", "hitting", "--tasks", "reach-*"), ("reach-few", "puck")),
        ((SUITE, "--view", "hitting", "--episodes", "0-72"), ("73 panels",)),
        ((SUITE, "--stat", "best"), ("--stat",)),
        (("curves", "--view", "paths", "--seed", 0), ("--view and --seed", "curves")),
        (("locomotion",), ("'locomotion'", "no scene")),
        (("locomotin",), ("kind of plot 'locomotin'",)),
        (("bluff",), ("kind of plot 'bluff'", "curves")),
    ],
)
def test_mistakes_are_refused_and_write_nothing(
    tmp_path: Path, lfobench_command: InProcess, runs: Path, arguments: tuple[object, ...], words: tuple[str, ...]
) -> None:
    assert_refused(lfobench_command("plot", *arguments, "--out", runs, "--to", tmp_path / "a.png"), *words)
    assert list(tmp_path.iterdir()) == []


def test_episodes_that_end_otherwise_than_recorded_are_warned_of(runs: Path) -> None:
    task = next(task for task in scene_suite.SUITE.tasks if task.name == "strike-few")
    (record,) = [each for each in RecordFolder(runs).read_all().records if (each.task, each.seed) == ("strike-few", 0)]
    traces, warnings = traces_of(runs, record, task, [0, 1, 5])
    found = [each.outcome for each in traces]
    assert warnings == []
    last = record.evaluations[-1]
    assert last.outcomes == found[:2]
    altered = record.model_copy(update={"evaluations": [last.model_copy(update={"outcomes": [found[0], "lost"]})]})
    _, (warning,) = traces_of(runs, altered, task, [0, 1, 5])
    assert f"start 1 {found[1]} (not lost)" in warning.what
    assert "start 0" not in warning.what and "start 5" not in warning.what


def test_missing_data_comes_with_the_command_that_makes_it(
    tmp_path: Path, lfobench_command: InProcess, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "empty"))
    done = lfobench_command("plot", SUITE, "--tasks", "reach-few", "--out", runs, "--to", tmp_path / "a.png")
    assert_refused(done, "lfobench data build", "--tasks reach-few")


def test_an_ending_and_a_place_that_cannot_be_written_are_refused(
    tmp_path: Path, lfobench_command: InProcess, runs: Path
) -> None:
    to = tmp_path / "a.gif"
    assert_refused(lfobench_command("plot", SUITE, "--out", runs, "--to", to), ".png, .svg or .pdf")
    (tmp_path / "file").write_text("")
    to = tmp_path / "file" / "a.png"
    view = ("--view", "hitting")
    assert_refused(lfobench_command("plot", SUITE, *view, "--out", runs, "--to", to), "Cannot write")
