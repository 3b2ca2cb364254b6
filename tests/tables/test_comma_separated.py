from __future__ import annotations

import csv
import io
from collections.abc import Callable

import pytest

from lfobench.errors import UserError
from lfobench.record import Record
from lfobench.tables.building import build_table
from lfobench.tables.exporters import FORMATS, export
from lfobench.tables.table import Table

HEADER = (
    "group,row,task,column,method,preset,column_group,n,mean,std,highlighted,lost_under_correction,outcome,p,"
    "adjusted_p,scores,seeds,diverged_seeds,failed_seeds,agreement,statistic,test,scope,correction,alpha,source,"
    "protocol"
)


def lines(records: list[Record]) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(export(build_table(records), "csv"))))


def test_one_line_per_cell(example: list[Record]) -> None:
    found = lines(example)
    assert len(found) == 4 * 5
    first = next(line for line in found if line["method"] == "smodice")
    assert ",".join(first) == HEADER
    assert first | dict.fromkeys(("mean", "std", "p", "adjusted_p", "scores"), "") == {
        "group": "random+expert",
        "row": "hopper",
        "task": "hopper-random-expert",
        "column": "smodice",
        "method": "smodice",
        "preset": "released",
        "column_group": "observations",
        "n": "3",
        "mean": "",
        "std": "",
        "highlighted": "1",
        "lost_under_correction": "0",
        "outcome": "undecided",
        "p": "",
        "adjusted_p": "",
        "scores": "",
        "seeds": "0 1 2",
        "diverged_seeds": "0",
        "failed_seeds": "",
        "agreement": "",
        "statistic": "last5",
        "test": "welch",
        "scope": "group",
        "correction": "none",
        "alpha": "0.05",
        "source": "generated",
        "protocol": "paper",
    }
    assert first["scores"] == "0.0 100.6 99.1"
    assert float(first["mean"]) == pytest.approx((0 + 100.6 + 99.1) / 3)


def test_the_header_never_changes(example: list[Record], marked: Table) -> None:
    """Scripts read these files by name."""
    for table in (build_table(example), build_table(example[:1]), marked):
        assert export(table, "csv").splitlines()[0] == HEADER


def test_every_mark_is_a_column(marked: Table) -> None:
    found = {(line["row"], line["column"]): line for line in csv.DictReader(io.StringIO(export(marked, "csv")))}
    assert len(found) == 4 * 4
    dilo = found["hopper", "dilo"]
    assert (dilo["highlighted"], dilo["lost_under_correction"], dilo["outcome"]) == ("1", "1", "better")
    assert float(dilo["p"]) < 0.05 <= float(dilo["adjusted_p"])
    assert (dilo["scores"], dilo["seeds"]) == ("96.0 100.0 104.0", "0 1 2")
    failed = found["walker2d", "oril"]
    assert (failed["n"], failed["mean"], failed["failed_seeds"], failed["scores"]) == ("0", "", "0 1", "")
    ant = found["ant", "dilo"]
    assert (ant["n"], ant["diverged_seeds"], ant["failed_seeds"]) == ("3", "1", "3 4")
    expert = found["hopper", "demonstration"]
    assert (expert["column_group"], expert["preset"], expert["mean"], expert["highlighted"]) == (
        "expert",
        "",
        "103.27",
        "0",
    )


def test_numbers_survive_the_round_trip(make_cell: Callable[..., list[Record]]) -> None:
    table = build_table(make_cell([1 / 3, 2 / 7, 1e-9]))
    cell = next(cell for _, _, cell in table.cells())
    line = next(csv.DictReader(io.StringIO(export(table, "csv"))))
    assert cell is not None
    assert (float(line["mean"]), float(line["std"])) == (cell.summary.mean, cell.summary.std)


def test_a_missing_cell_has_no_samples(example: list[Record]) -> None:
    missing = [line for line in lines(example) if line["n"] == "0"]
    assert [(line["task"], line["method"], line["mean"]) for line in missing] == [
        ("halfcheetah-random-few-expert", "oril", "")
    ]


def test_what_is_undefined_is_empty(make_record: Callable[..., Record]) -> None:
    line = lines([make_record(1.0), make_record(2.0, "oril")])[0]
    assert (line["std"], line["p"]) == ("", "")


def test_names_with_commas_and_quotes(make_record: Callable[..., Record]) -> None:
    assert lines([make_record(1.0, 'a,"b"')])[0]["method"] == 'a,"b"'


def test_an_unknown_format_names_the_closest() -> None:
    with pytest.raises(UserError, match=r"Unknown format 'markdwon'.*'markdown'"):
        export(None, "markdwon")  # type: ignore[arg-type]
    assert set(FORMATS) == {"markdown", "latex", "csv", "json", "html"}
