from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from lfobench.record import Record
from lfobench.tables.comparable import arrange_columns


def labels(records: list[Record]) -> list[str]:
    return [column.label for column in arrange_columns(records)]


def test_a_lone_column_goes_by_the_method(make_record: Callable[..., Record]) -> None:
    assert labels([make_record(1.0, preset="paper", set={"tau": 3.0}, seed=seed) for seed in range(3)]) == ["dilo"]


def test_presets_are_columns_of_their_own(make_record: Callable[..., Record]) -> None:
    records = [make_record(1.0), make_record(1.0, preset="paper"), make_record(1.0, "oril")]
    assert labels(records) == ["dilo:released", "dilo:paper", "oril"]


def test_options_set_by_hand_are_columns_of_their_own(make_record: Callable[..., Record]) -> None:
    records = [
        make_record(1.0),
        make_record(1.0, set={"tau": 3}, config={"tau": 3}),
        make_record(1.0, set={"tau": 3, "mode": "exact"}, config={"tau": 3, "mode": "exact"}),
    ]
    assert labels(records) == ["dilo", "dilo(tau=3)", 'dilo(tau=3, mode="exact")']


@pytest.mark.parametrize(("one", "two"), [(1, 1.0), (1, True), (3, "3"), (None, 0)])
def test_values_that_python_confuses_stay_apart(one: Any, two: Any, make_record: Callable[..., Record]) -> None:
    records = [make_record(1.0), make_record(1.0, set={"x": one}), make_record(1.0, set={"x": two})]
    assert len(set(labels(records))) == 3


def test_defaults_that_changed_between_runs_are_columns_of_their_own(make_record: Callable[..., Record]) -> None:
    records = [make_record(1.0, config={"tau": tau, "eta": 0.5}) for tau in (0.06, 3.0)]
    assert labels(records) == ["dilo(tau=0.06)", "dilo(tau=3.0)"]


def test_a_config_that_follows_the_task_is_one_column(make_record: Callable[..., Record]) -> None:
    records = [make_record(1.0, row=row, config={"tau": tau}) for row, tau in (("hopper", 0.06), ("ant", 3.0))]
    assert labels(records) == ["dilo"]


def test_versions_of_a_method_are_columns_of_their_own(make_record: Callable[..., Record]) -> None:
    assert labels([make_record(1.0), make_record(1.0, method_version=2)]) == ["dilo@1", "dilo@2"]


def test_every_record_lands_in_exactly_one_column(example: list[Record]) -> None:
    columns = arrange_columns(example)
    assert sorted(record.identity_hash for members in columns.values() for record in members) == sorted(
        record.identity_hash for record in example
    )
