"""The published table, and the claim that the highlight rule is the one its authors used."""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path

import pytest

from lfobench.errors import UserError
from lfobench.stats.highlight import highlight
from lfobench.stats.summary import Summary
from lfobench.store.published import PublishedCell, read_published

FOLDER = Path(__file__).parents[2] / "results" / "published" / "dilo-2024"
ROWS = 24
METHODS = {"rce", "bc-expert", "bc", "iqlearn", "recoil", "oril", "smodice", "dilo", "expert"}


def rows_of(cells: list[PublishedCell]) -> dict[tuple[str, ...], dict[str, PublishedCell]]:
    rows: dict[tuple[str, ...], dict[str, PublishedCell]] = {}
    for cell in cells:
        rows.setdefault(tuple(cell.place.values()), {})[cell.method] = cell
    return rows


def test_table_1_is_complete() -> None:
    rows = rows_of(read_published(FOLDER / "table1.csv"))
    assert len(rows) == ROWS
    assert all(set(row) == METHODS for row in rows.values())


@pytest.mark.parametrize("seeds", [5, 7])
def test_the_highlight_rule_reproduces_every_published_highlight(seeds: int) -> None:
    for place, row in rows_of(read_published(FOLDER / "table1.csv")).items():
        judged = {method: cell for method, cell in row.items() if cell.highlighted is not None}
        assert set(judged) == {"oril", "smodice", "dilo"}
        summaries = {method: Summary(seeds, cell.mean, cell.std) for method, cell in judged.items()}
        published = {method for method, cell in judged.items() if cell.highlighted}
        assert highlight(summaries, alpha=0.05).methods == published, place


def test_the_robomimic_table_has_the_same_form() -> None:
    cells = read_published(FOLDER / "robomimic.csv")
    assert len(cells) == 24
    assert cells[0].place == {"observations": "state", "demos": "50", "dataset": "lift-mg"}
    assert all(0.0 <= cell.mean <= 1.0 for cell in cells)


def test_successes_do_not_exceed_trials() -> None:
    with (FOLDER / "airhockey.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert lines
    assert all(0 <= int(line["successes"]) <= int(line["trials"]) for line in lines)


def test_every_file_has_a_provenance() -> None:
    provenance = tomllib.loads((FOLDER / "provenance.toml").read_text(encoding="utf-8"))
    described = {entry["file"] for entry in provenance.values() if isinstance(entry, dict)}
    assert described == {path.name for path in FOLDER.glob("*.csv")}
    assert provenance["url"] == "https://arxiv.org/abs/2406.08805v2"


def test_a_file_of_another_form_is_refused_by_name() -> None:
    with pytest.raises(UserError, match=r"airhockey\.csv.*mean, std"):
        read_published(FOLDER / "airhockey.csv")


def test_a_value_that_is_no_number_is_refused_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text("env,method,mean,std,highlighted\nhopper,dilo,97.9,8.1,1\nhopper,oril,many,1.0,0\n")
    with pytest.raises(UserError, match=r"table\.csv, line 3.*many"):
        read_published(file)
