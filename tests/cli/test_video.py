"""``lfobench video``: a file that plays, and one line for every mistake."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import scene_suite
from helpers_cli import InProcess, Outcome, assert_refused
from helpers_engine import finish, make_job, smoke_cell
from PIL import Image

from lfobench.plots import film as movie

SUITE = str(Path(scene_suite.__file__))
TASK = "strike-few"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory, shared_cache: Path) -> Path:
    """One seed of behaviour cloning."""
    out = tmp_path_factory.mktemp("video") / "runs"
    finish(make_job(smoke_cell("bc", TASK, SUITE), (0,), out, shared_cache))
    return out


def film(command: InProcess, out: Path, to: Path, *arguments: object, names: tuple[str, str] = ("bc", TASK)) -> Outcome:
    return command("video", *names, "--suite", SUITE, "--out", out, "--to", to, *arguments)


def test_a_film_shows_the_episodes_one_after_the_other(tmp_path: Path, lfobench_command: InProcess, runs: Path) -> None:
    to = tmp_path / "new" / "film.gif"
    done = film(lfobench_command, runs, to, "--episodes", "0,2")
    assert done.code == 0, done
    assert "start 0 " in done.out and "start 2 " in done.out
    with Image.open(to) as image:
        assert image.n_frames > 2
        # Ten steps a second, says the environment.
        assert image.info["duration"] % 100 == 0
    assert list(to.parent.iterdir()) == [to]


def test_mp4_is_written_where_its_encoder_is_installed_and_refused_where_not(
    tmp_path: Path, lfobench_command: InProcess, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("imageio_ffmpeg")
    to = tmp_path / "film.mp4"
    assert film(lfobench_command, runs, to, "--episode", 1).code == 0
    assert to.read_bytes()[4:8] == b"ftyp"
    to.unlink()
    monkeypatch.setattr(movie, "find_spec", lambda name: None)
    assert_refused(film(lfobench_command, runs, to), "lfobench[video]", ".gif")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("names", "arguments", "words"),
    [
        (("dilo", TASK), (), ("dilo", "bc")),
        (("bc", "strike-fw"), (), ("Did you mean 'strike-few'",)),
        (("bc", TASK), ("--seed", 3), ("seed 3",)),
        (("bc", TASK), ("--episode", "one"), ("'one'",)),
        (("bc", TASK), ("--episodes", "0-99"), ("100 episodes", "12")),
    ],
)
def test_mistakes_are_refused_and_write_nothing(
    tmp_path: Path,
    lfobench_command: InProcess,
    runs: Path,
    names: tuple[str, str],
    arguments: tuple[object, ...],
    words: tuple[str, ...],
) -> None:
    assert_refused(film(lfobench_command, runs, tmp_path / "a.gif", *arguments, names=names), *words)
    assert list(tmp_path.iterdir()) == []


def test_a_suite_that_is_not_registered_is_asked_for(tmp_path: Path, lfobench_command: InProcess, runs: Path) -> None:
    done = lfobench_command("video", "bc", TASK, "--out", runs, "--to", tmp_path / "a.gif")
    assert_refused(done, "'above'", "--suite")


def test_an_ending_and_a_place_that_cannot_be_written_are_refused(
    tmp_path: Path, lfobench_command: InProcess, runs: Path
) -> None:
    assert_refused(film(lfobench_command, runs, tmp_path / "a.avi"), ".gif or .mp4")
    (tmp_path / "file").write_text("")
    assert_refused(film(lfobench_command, runs, tmp_path / "file" / "a.gif"), "Cannot write", "--to")


def test_a_policy_that_is_missing_or_damaged_is_named(tmp_path: Path, lfobench_command: InProcess, runs: Path) -> None:
    copy = tmp_path / "runs"
    shutil.copytree(runs, copy)
    (policy,) = (copy / "policies").rglob("*.safetensors")
    policy.write_bytes(policy.read_bytes()[:-100])
    assert_refused(film(lfobench_command, copy, tmp_path / "a.gif"), policy.name, "lfobench run")
    policy.unlink()
    assert_refused(film(lfobench_command, copy, tmp_path / "a.gif"), policy.name, "lfobench run")
    assert not (tmp_path / "a.gif").exists()
