"""``lfobench report``: one file, whole or not at all, that opens with the knobs that were asked for."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from lfobench.cli.figures import report
from lfobench.errors import UserError

REFERENCE = Path(__file__).resolve().parents[2] / "results" / "reference" / "locomotion-quick"


def command(*arguments: object) -> Result:
    app = typer.Typer()
    app.command()(report)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_page_is_written_with_its_knobs_and_filters(tmp_path: Path) -> None:
    to = tmp_path / "new" / "report.html"
    done = command(
        *("--out", REFERENCE, "--to", to, "--title", "Ours & <theirs>", "--methods", "dilo,smodice"),
        *("--test", "student", "--correction", "holm", "--alpha", "0.01"),
    )
    assert done.exit_code == 0, done.output
    assert str(to) in done.stdout
    page = to.read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert "<h1>Ours &amp; &lt;theirs&gt;</h1>" in page
    assert '<option value="student" selected>' in page
    assert "--methods dilo,smodice" in page
    assert ">bc<" not in page
    assert list(to.parent.iterdir()) == [to]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--test", "welsh"), "Did you mean 'welch'"),
        (("--stat", "median"), "Unknown statistic"),
        (("--methods", "oril"), "oril"),
        (("--protocol", "paper"), "passes the filters"),
    ],
)
def test_mistakes_are_refused_and_write_nothing(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    to = tmp_path / "report.html"
    done = command("--out", REFERENCE, "--to", to, *arguments)
    assert isinstance(done.exception, UserError)
    assert words in str(done.exception)
    assert not to.exists()
