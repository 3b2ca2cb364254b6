"""The example that the README shows, executed on the reference records; and what its functions refuse."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from helpers_cli import InProcess

import lfobench
from lfobench.analyses.audit import json_audit
from lfobench.analyses.compare_formats import json_comparison
from lfobench.analyses.power_formats import json_power
from lfobench.errors import UserError
from lfobench.tables.exporters import export

ROOT = Path(__file__).resolve().parent.parent
RECORDS = ROOT / "results" / "reference" / "locomotion-quick"


def test_the_example_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(ROOT / "docs" / "from_python.py"))["main"](str(RECORDS), tmp_path)
    assert "hopper-random-expert" in capsys.readouterr().out
    assert (tmp_path / "table.tex").read_text(encoding="utf-8").count(r"\begin{tabular}") == 1
    for name in ("curves.pdf", "scores.pdf"):
        assert (tmp_path / name).read_bytes().startswith(b"%PDF")
    assert (tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_the_table_is_the_one_of_the_command_line(lfobench_command: InProcess) -> None:
    knobs = {"test": "student", "scope": "all", "correction": "bh", "alpha": 0.01, "statistic": "at:12000"}
    options = [word for name, value in knobs.items() for word in (f"--{name}".replace("statistic", "stat"), value)]
    printed = lfobench_command("table", "--out", RECORDS, "--format", "json", *options)
    assert printed.code == 0
    assert export(lfobench.table(RECORDS, **knobs), "json") == printed.out  # type: ignore[arg-type]


def test_a_notebook_shows_the_table() -> None:
    shown = lfobench.table(RECORDS)._repr_html_()
    assert "<table" in shown
    assert "dilo" in shown


def test_against_a_publication(lfobench_command: InProcess) -> None:
    with pytest.raises(UserError, match="--anyway"):
        lfobench.table(RECORDS, against="dilo-2024")
    with pytest.raises(UserError, match="not a margin"):
        lfobench.table(RECORDS, against="dilo-2024", margin=0.0, anyway=True)
    refused = lfobench_command("table", "--out", RECORDS, "--against", "dilo-2024")
    assert refused.code == 2
    assert "the source is 'generated' here and 'd4rl' there" in refused.err
    shown = lfobench_command("table", "--out", RECORDS, "--against", "dilo-2024", "--anyway", "--format", "csv")
    assert shown.code == 0
    assert "incomparable" in shown.out


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = (
        "import sys, lfobench; sys.exit(any(name in sys.modules for name in ('torch', 'pandas', 'numpy', 'pydantic')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("knobs", "message"),
    [
        ({"test": "welsh"}, "Unknown test 'welsh'. Did you mean 'welch'?"),
        ({"scope": "some"}, "Unknown scope 'some'"),
        ({"correction": "bonferroni"}, "Unknown correction 'bonferroni'"),
        ({"statistic": "first"}, "Unknown statistic 'first'"),
        ({"statistic": "at:999"}, "was not evaluated at step 999"),
        ({"alpha": 2.0}, "alpha = 2.0 is not a level"),
        ({"methods": "dillo"}, "Unknown method among these records 'dillo'"),
    ],
)
def test_a_wrong_knob_is_named(knobs: dict[str, str], message: str) -> None:
    with pytest.raises(UserError) as refused:
        lfobench.table(RECORDS, **knobs)  # type: ignore[arg-type]
    assert message in str(refused.value)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'tabel'"):
        lfobench.tabel  # noqa: B018


def test_judgements_are_those_of_the_command_line(lfobench_command: InProcess) -> None:
    compared = lfobench.compare("dilo", "smodice", RECORDS, correction="none")
    printed = lfobench_command("compare", "dilo", "smodice", "--out", RECORDS, "--correction", "none", "--json")
    assert json_comparison(compared) == printed.out
    assert not compared.regressed
    audited = lfobench_command("audit", "dilo-2024", "--n", "5,7", "--format", "json")
    assert json_audit(lfobench.audit("dilo-2024", sizes=[7, 5])) == audited.out
    planned = lfobench_command("power", "--out", RECORDS, "--seeds", "4", "--json")
    assert json_power(lfobench.power(RECORDS, seeds=4)) == planned.out


def test_judgements_refuse_what_the_command_line_refuses(tmp_path: Path) -> None:
    for call, said in (
        (lambda: lfobench.compare("dilo", "nobody", RECORDS), "nobody"),
        (lambda: lfobench.compare("dilo", "smodice", RECORDS, allow=["simulator"]), "--allow"),
        (lambda: lfobench.compare(RECORDS, tmp_path / "nowhere"), "nowhere"),
        (lambda: lfobench.audit("dilo-2024", sizes=[1]), "at least 2"),
        (lambda: lfobench.audit("dilo-2024", count_test="chi2"), "fisher"),
        (lambda: lfobench.audit("dilo-2024", correction="bonferroni"), "holm"),
        (lambda: lfobench.power(tmp_path), "no records|no folder|holds no"),
        (lambda: lfobench.check("nobody"), "nobody"),
        (lambda: lfobench.video("dilo", "hopper-random-expert", tmp_path / "film.txt", RECORDS), "film.txt"),
    ):
        with pytest.raises(UserError, match=said):
            call()


def test_a_method_is_checked() -> None:
    assert all(not finding.problem for finding in lfobench.check("bc"))
    with pytest.raises(UserError, match="no_such_field"):
        lfobench.check("bc", set={"no_such_field": 1})
