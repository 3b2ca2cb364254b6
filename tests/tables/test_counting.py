"""Records to counts: which episodes count, whose records count at all."""

from __future__ import annotations

from typing import Any

import pytest
from helpers_records import endings, make_cell, make_counted, make_record
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.errors import UserError
from lfobench.record import SUCCESS, Record
from lfobench.score import parse_statistic
from lfobench.stats.highlight import Rule
from lfobench.stats.successes import Count
from lfobench.tables.building import build_table
from lfobench.tables.counting import (
    check_counts,
    counts_successes,
    final_outcomes,
    fixed_outcomes,
    scores_are_success_rates,
    some_count_successes,
    successes_of,
)
from lfobench.tables.table import Cell, Table

FISHER = Rule("fisher")

outcomes = st.lists(st.sampled_from([SUCCESS, "cup hit", "stalled"]), min_size=2, max_size=2)
further = st.lists(st.sampled_from([SUCCESS, "out of time"]), max_size=4)
LATEST = parse_statistic("success")


def cell_of(table: Table, label: str) -> Cell:
    return next(cell for _, column, cell in table.cells() if column.label == label and cell is not None)


@settings(max_examples=40)
@given(st.lists(st.tuples(outcomes, further), min_size=1, max_size=5))
def test_pooled_counts_equal_a_plain_count(seeds: list[tuple[list[str], list[str]]]) -> None:
    # One task plans one number of further starts.
    most = max(len(beyond) for _, beyond in seeds)
    padded = [(fixed, beyond + ["stalled"] * (most - len(beyond))) for fixed, beyond in seeds]
    records = [make_counted(fixed, beyond, seed=seed) for seed, (fixed, beyond) in enumerate(padded)]
    found = cell_of(build_table(records, rule=FISHER), "dilo").successes
    assert found is not None
    every = [outcome for fixed, beyond in padded for outcome in (*fixed, *beyond)]
    assert found.pooled == Count(every.count(SUCCESS), len(every))
    assert found.fixed == Count(sum(fixed.count(SUCCESS) for fixed, _ in padded), 2 * len(padded))
    assert [count.successes for count in found.seeds] == [(fixed + beyond).count(SUCCESS) for fixed, beyond in padded]


def test_only_the_last_evaluation_counts() -> None:
    """The earlier evaluations of `make_counted` have no success, and the score knows it."""
    record = make_counted(endings(7, 10), endings(70, 100), evaluations=4)
    found = successes_of([record])
    assert (found.fixed, found.pooled) == (Count(7, 10), Count(77, 110))
    assert record.score() == pytest.approx(70.0 / 4)


def test_the_episodes_of_a_diverged_seed_are_failures_in_the_denominator() -> None:
    whole = make_counted(endings(9, 10), endings(90, 100))
    before_any = make_counted(endings(9, 10), endings(90, 100), seed=1, diverged_at=300)
    after_one = whole.model_copy(update={"status": "diverged", "diverged_at": 2500, "further": None})
    found = successes_of([whole, before_any, after_one])
    assert found.seeds == (Count(99, 110), Count(0, 110), Count(0, 110))
    assert (found.fixed, found.pooled) == (Count(9, 30), Count(99, 330))
    for record in (before_any, after_one):
        assert set(fixed_outcomes(record)) == set(final_outcomes(record)) == {"diverged"}


def without_outcomes(record: Record) -> Record:
    bare = [evaluation.model_copy(update={"outcomes": None}) for evaluation in record.evaluations]
    return record.model_copy(update={"evaluations": bare})


def test_who_counts() -> None:
    counted, diverged = make_counted(endings(1, 2)), make_counted(endings(1, 2), seed=1, diverged_at=9)
    plain = make_record(50.0)
    assert counts_successes([counted, diverged])
    for records in ([], [diverged], [plain], [counted, plain], [without_outcomes(counted)]):
        assert not counts_successes(records)
    assert some_count_successes([counted, plain])
    assert not some_count_successes([plain, diverged])
    half = make_counted(endings(1, 2), endings(1, 2))
    assert half.further is not None
    silent = half.model_copy(update={"further": half.further.model_copy(update={"outcomes": None})})
    assert not counts_successes([silent]), "episodes that say nothing are no failures"


def test_when_scores_are_success_rates() -> None:
    record = make_counted(endings(1, 2), endings(1, 3))
    assert scores_are_success_rates([record])
    assert not scores_are_success_rates([make_record(50.0)])
    paid = [each.model_copy(update={"returns": [0.5] * len(each.returns)}) for each in record.evaluations]
    assert not scores_are_success_rates([record.model_copy(update={"evaluations": paid})])


def test_records_that_do_not_say_are_refused_by_name() -> None:
    records = [make_counted(endings(1, 2)), *make_cell([1.0, 2.0], "oril")]
    with pytest.raises(UserError) as refused:
        check_counts(records, LATEST)
    assert "2 of 3 records do not say how their episodes ended, e.g. oril on hopper-random-expert" in str(refused.value)
    assert "--test welch" in refused.value.remedy
    with pytest.raises(UserError, match="1 of 1 records"):
        check_counts([make_counted(endings(1, 2), diverged_at=3)], LATEST)


@pytest.mark.parametrize(
    ("statistic", "allowed"),
    [("success", True), ("last5", False), ("last", False), ("best", False), ("at:1000", False)],
)
def test_a_statistic_that_picks_evaluations_has_no_counts(statistic: str, allowed: bool) -> None:
    records: list[Any] = [make_counted(endings(1, 2))]
    if allowed:
        build_table(records, parse_statistic(statistic), FISHER)
    else:
        with pytest.raises(UserError, match=rf"--stat {statistic}.*--test welch"):
            build_table(records, parse_statistic(statistic), FISHER)


def test_scores_are_built_as_ever_unless_counts_are_asked_for() -> None:
    records = [make_counted(endings(1, 2), seed=seed) for seed in range(3)]
    table = build_table(records)
    assert not table.counts and table.success_rates
    assert cell_of(table, "dilo").successes is None
    assert not build_table(make_cell([1.0, 2.0])).success_rates
