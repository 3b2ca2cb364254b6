"""The JSON format parses and carries everything that the table knows."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from helpers_folders import with_provenance

from lfobench.record import Failure, Record
from lfobench.score import Statistic
from lfobench.stats.highlight import Rule
from lfobench.stats.intervals import Summary
from lfobench.tables.building import build_table
from lfobench.tables.exporters import export
from lfobench.tables.published_columns import PublishedScores, with_published
from lfobench.tables.table import Table, column_groups


def parsed(table: Table) -> dict[str, Any]:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    value = json.loads(export(table, "json"), parse_constant=refuse)
    assert isinstance(value, dict)
    return value


@pytest.fixture
def table(example: list[Record]) -> Table:
    """A diverged seed, a missing cell, failed seeds, the demonstration and a published number."""
    records = [with_provenance(record, demonstration_score=103.25) for record in example]
    last = next(record for record in reversed(records) if record.method == "dilo")
    failures = [
        Failure(
            identity_hash=f"{seed}",
            identity={**last.identity, "seed": seed},
            labels=last.labels,
            error="x",
            traceback=[],
        )
        for seed in (8, 7)
    ]
    built = build_table(records, Statistic("at", 3000), Rule("student", "group", "holm", 0.1), failures=failures)
    scores = {(last.task, "dilo"): Summary(5, 101.0, 0.5)}
    return with_published(built, PublishedScores("theirs", "generated", "paper", scores, "n = 5."), 5.0, 0.05, False)


def test_it_carries_the_conditions_and_the_rule(table: Table) -> None:
    found = parsed(table)
    assert list(found) == ["statistic", "source", "protocol", "rule", "columns", "rows", "notes"]
    assert (found["statistic"], found["source"], found["protocol"]) == ("at:3000", "generated", "paper")
    assert found["rule"] == {"test": "student", "scope": "group", "correction": "holm", "alpha": 0.1}
    assert found["notes"] == [{"label": note.label, "text": note.text} for note in table.notes]


def test_columns_know_their_group(table: Table) -> None:
    labels = [
        (table.columns[index].label, group.label)
        for group in column_groups(table.columns)
        for index in range(group.start, group.stop)
    ]
    columns = parsed(table)["columns"]
    assert [(column["label"], column["group"]) for column in columns] == labels
    assert [(column["method"], column["preset"]) for column in columns] == [
        (column.method, column.preset) for column in table.columns
    ]
    assert {group for _, group in labels} == {"Access to expert actions", "No expert actions", "Expert", "Published"}


def test_every_cell_carries_everything_behind_it(table: Table) -> None:
    found = parsed(table)["rows"]
    for (block, row), line in zip(table.rows(), found, strict=True):
        assert (line["group"], line["row"], line["task"]) == (block.label, row.label, row.task)
        assert (line["outcome"], line["p"], line["adjusted_p"]) == (row.outcome, row.p, row.adjusted_p)
        for cell, value in zip(row.cells, line["cells"], strict=True):
            if cell is None:
                assert value is None
                continue
            assert cell.sample is not None and cell.summary is not None
            assert value == {
                "n": cell.summary.n,
                "mean": cell.summary.mean,
                "std": cell.summary.std,
                "scores": list(cell.sample.seeds),
                "seeds": list(cell.seeds),
                "diverged_seeds": list(cell.diverged_seeds),
                "failed_seeds": list(cell.failed_seeds),
                "highlighted": cell.highlighted,
                "lost_under_correction": cell.lost,
                "agreement": cell.agreement,
            }
    cells = [cell for line in found for cell in line["cells"] if cell]
    assert [cell["failed_seeds"] for cell in cells if cell["failed_seeds"]] == [[7, 8]]
    assert [cell["diverged_seeds"] for cell in cells if cell["diverged_seeds"]] == [[0]]
    assert [cell["agreement"] for cell in cells if cell["agreement"]] == ["matches"]
    assert sum(cell is None for line in found for cell in line["cells"][:-2]) == 1, "oril's missing cell"


def test_a_cell_without_a_score_has_no_mean(make_cell: Callable[..., list[Record]]) -> None:
    records = make_cell([1.0, 2.0]) + make_cell([1.0], "oril", row="ant")
    failed = make_cell([0.0], row="ant")[0]
    failure = Failure(
        identity_hash=failed.identity_hash, identity=failed.identity, labels=failed.labels, error="x", traceback=[]
    )
    (_, ant) = parsed(build_table(records, failures=[failure]))["rows"]
    by_label = dict(zip(("dilo", "oril"), ant["cells"], strict=True))
    assert by_label["dilo"] == {
        "n": 0,
        "mean": None,
        "std": None,
        "scores": [],
        "seeds": [],
        "diverged_seeds": [],
        "failed_seeds": [0],
        "highlighted": False,
        "lost_under_correction": False,
        "agreement": None,
    }
    assert (by_label["oril"]["n"], by_label["oril"]["std"]) == (1, None)


def test_names_come_back_as_they_were(make_record: Callable[..., Record]) -> None:
    name = 'a"b\\c\n§ é 中 </script>'
    found = parsed(build_table([make_record(1.0, "dilo", row=name, group=name, task=name)]))
    assert found["rows"][0]["task"] == name
    assert found["rows"][0]["group"] == name
