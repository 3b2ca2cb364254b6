"""``lfobench audit`` as a user types it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from lfobench.cli.tables import audit
from lfobench.errors import UserError

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(audit)

TABLE = "task,method,mean,std,n,highlighted\nhop,a,9,1,5,1\nhop,b,1,1,5,0\nhop,c,8.9,1,5,0\n"


def call(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused(*arguments: object) -> str:
    with pytest.raises(UserError) as error:
        call(*arguments)
    assert error.value.remedy
    return str(error.value)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    file = tmp_path / "mine.csv"
    file.write_text(TABLE)
    return file


def test_the_seed_paper() -> None:
    text = " ".join(call("dilo-2024").split())
    assert "with n = 5, 24 of 24 printed highlights follow, and Holm leaves 12 of 16 single winners" in text
    assert "with n = 7, 24 of 24 printed highlights follow, and Holm leaves 15 of 16 single winners" in text
    assert "no row has a better method by Fisher's exact test (smallest p 0.0573" in text
    assert "10 of 10 highlighted rows mark merely the largest count" in text


def test_the_options_reach_the_numbers() -> None:
    value = json.loads(
        call("dilo-2024", "--n", "7,4", "--test", "student", "--count-test", "boschloo", "--format", "json")
    )
    first, robomimic, robot = value["tables"]
    assert [at_n["n"] for at_n in first["by_n"]] == [at_n["n"] for at_n in robomimic["by_n"]] == [4, 7]
    assert first["rule"] == {"test": "student", "correction": "none", "alpha": 0.05}
    assert robot["rule"]["test"] == "boschloo"


def test_a_file_with_its_own_n(table: Path) -> None:
    value = json.loads(call(table, "--format", "json", "--correction", "holm", "--alpha", "0.01"))
    (found,) = value["tables"]
    assert value["publication"] == "mine"
    assert found["by_n"][0]["n"] is None
    assert found["by_n"][0]["rows"][0]["by_the_rule"] == ["a", "c"]
    assert found["rule"] == {"test": "welch", "correction": "holm", "alpha": 0.01}


def test_who_competes(table: Path) -> None:
    assert json.loads(call(table, "--format", "json", "--methods", "a,b"))["tables"][0]["by_n"][0]["follow"] == 1
    # The robot and robomimic tables have neither.
    tables = json.loads(call("dilo-2024", "--format", "json", "--methods", "rce,dilo"))["tables"]
    (first, *others) = tables
    assert first["by_n"][0]["follow"] < 24
    # The paper does not contradict itself because a reader lets others compete.
    assert not [found for table in tables for found in table["contradictions"] if "highlighted" in found["text"]]
    assert [found["compared"] for found in others] == [["dilo"], ["dilo"]]
    (only,) = json.loads(call("dilo-2024", "--format", "json", "--methods", "rce,recoil"))["tables"]
    assert only["table"] == "Table 1"


def test_markdown(table: Path) -> None:
    assert call(table, "--format", "markdown").startswith("# Audit of mine\n")


def test_a_test_that_needs_scores_is_refused_with_the_reason(table: Path) -> None:
    for test in ("mann-whitney", "permutation", "paired-t", "wilcoxon", "paired-permutation"):
        said = refused(table, "--test", test)
        assert test in said and "needs every score" in said and "welch or student" in said
    assert "Did you mean 'welch'?" in refused(table, "--test", "welsh")


def test_other_mistakes(table: Path, tmp_path: Path) -> None:
    for n in ("", "1", "five", "5,,7", "-3", "5.0", "²"):
        assert "--n" in refused(table, "--n", n)
    assert "alpha" in refused(table, "--alpha", "0")
    assert "nothing to be compared with" in refused(table, "--methods", "a")
    assert "Unknown method" in refused(table, "--methods", "a,zz")
    assert "Did you mean 'dilo-2024'?" in refused("dilo-2042")
    robot = tmp_path / "robot.csv"
    robot.write_text("task,method,successes,trials\nreach,a,1,2\nreach,b,2,2\n")
    assert "Leave out --n" in refused(robot, "--n", "5")
