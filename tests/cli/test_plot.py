"""``lfobench plot``: one file, whole or not at all, and its caption on standard output."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers_cli import InProcess, assert_refused

from lfobench.plots.kinds import PLOTS

REFERENCE = Path(__file__).resolve().parents[2] / "results" / "reference" / "locomotion-quick"


@pytest.mark.parametrize(("name", "magic"), [("figure.SVG", b"<?xml"), ("new/figure.pdf", b"%PDF-")])
def test_a_figure_is_written_in_the_format_of_its_name(
    tmp_path: Path, lfobench_command: InProcess, name: str, magic: bytes
) -> None:
    to = tmp_path / name
    done = lfobench_command("plot", "scores", "--out", REFERENCE, "--to", to, "--width", "page")
    assert done.code == 0, done
    assert to.read_bytes().startswith(magic)
    assert done.out.startswith("Scores per task: every dot is one seed")
    assert done.out.count("\n") == 1
    assert list(to.parent.iterdir()) == [to]


def test_methods_and_statistic_are_those_asked_for(tmp_path: Path, lfobench_command: InProcess) -> None:
    to = tmp_path / "figure.svg"
    done = lfobench_command(
        "plot", "scores", "--out", REFERENCE, "--to", to, "--methods", "dilo,bc", "--stat", "at:10000"
    )
    assert done.code == 0, done
    assert "evaluation at step 10,000" in done.out
    drawn = to.read_text(encoding="utf-8")
    assert ">dilo<" in drawn
    assert "smodice" not in drawn


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("curve", "--to", "figure.pdf"), "Did you mean 'curves'"),
        (("curves", "--to", "figure.jpg"), ".png, .svg or .pdf"),
        (("curves", "--to", "figure.pdf", "--stat", "median"), "Unknown statistic"),
        (("ranking", "--to", "figure.pdf", "--methods", "dilo,bc"), "needs 2 tasks and 3 methods"),
    ],
)
def test_mistakes_are_refused_and_write_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    lfobench_command: InProcess,
    arguments: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused(lfobench_command("plot", *arguments, "--out", REFERENCE), words)
    assert list(tmp_path.iterdir()) == []


def test_help_names_every_kind(lfobench_command: InProcess) -> None:
    shown = lfobench_command("plot", "--help").out
    assert all(kind in shown for kind in PLOTS)
