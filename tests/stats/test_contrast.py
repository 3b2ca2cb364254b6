from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.stats.aggregates import interquartile_mean, probability_of_improvement
from lfobench.stats.contrast import Contrast, best_p, contrast
from lfobench.stats.highlight import Rule, adjusted
from lfobench.stats.tests import Sample, p_value, sample_of

RULE = Rule(correction="holm")
FLIPPED = {"better": "worse", "worse": "better", "undecided": "undecided", "untested": "untested"}

score = st.integers(-20_000, 130_000).map(lambda thousandths: thousandths / 1000)
scores = st.lists(score, min_size=1, max_size=5)
cells = st.lists(st.tuples(scores, scores), min_size=1, max_size=4)


def judge(pairs: list[tuple[list[float], list[float]]], rule: Rule = RULE, replicates: int = 50) -> Contrast[int]:
    return contrast(
        {index: (sample_of(one), sample_of(two)) for index, (one, two) in enumerate(pairs)}, rule, replicates
    )


def test_each_verdict() -> None:
    found = judge(
        [([90, 91, 92], [50, 51, 52]), ([50, 51, 52], [90, 91, 92]), ([50, 60, 70], [55, 61, 66]), ([9], [1, 2])]
    )
    assert [cell.outcome for cell in found.cells.values()] == ["better", "worse", "undecided", "untested"]
    assert [found.having(outcome) for outcome in ("better", "worse", "undecided", "untested")] == [[0], [1], [2], [3]]
    assert found.cells[0].difference == pytest.approx(40.0)
    assert found.tested == [0, 1, 2]


@settings(max_examples=25)
@given(cells)
def test_swapping_the_sides_flips_every_verdict(pairs: list[tuple[list[float], list[float]]]) -> None:
    one, two = judge(pairs, replicates=2), judge([(second, first) for first, second in pairs], replicates=2)
    for cell, mirrored in zip(one.cells.values(), two.cells.values(), strict=True):
        assert mirrored.outcome == FLIPPED[cell.outcome]
        assert mirrored.difference == -cell.difference
        assert mirrored.adjusted_p == pytest.approx(cell.adjusted_p)
        if cell.interval is not None and mirrored.interval is not None:
            assert (mirrored.interval.low, mirrored.interval.high) == pytest.approx(
                (-cell.interval.high, -cell.interval.low)
            )


@settings(max_examples=25)
@given(cells, st.sampled_from(["none", "holm", "bh"]))
def test_p_values_are_the_tests_and_corrected_over_what_was_tested(
    pairs: list[tuple[list[float], list[float]]], correction: str
) -> None:
    found = judge(pairs, replace(RULE, correction=correction), replicates=2)  # type: ignore[arg-type]
    expected = [p_value("welch", sample_of(one), sample_of(two)) for one, two in pairs]
    assert [cell.p for cell in found.cells.values()] == expected
    tested = [p for p in expected if p is not None]
    assert [cell.adjusted_p for cell in found.cells.values() if cell.p is not None] == adjusted(
        tested,
        correction,  # type: ignore[arg-type]
    )


@settings(max_examples=25)
@given(cells)
def test_alone_and_uncorrected_the_interval_and_the_verdict_say_the_same(
    pairs: list[tuple[list[float], list[float]]],
) -> None:
    for cell in judge(pairs, Rule(), replicates=2).cells.values():
        if cell.interval is not None and cell.p is not None and not math.isclose(cell.p, 0.05):
            assert (cell.interval.low <= 0.0 <= cell.interval.high) == (cell.outcome == "undecided")


def test_what_is_clear_alone_is_not_clear_among_many() -> None:
    weak = ([60.0, 64.0, 66.0], [50.0, 53.0, 56.0])
    noise = [([50.0 + k, 60.0, 70.0], [55.0, 61.0 + k, 66.0]) for k in range(9)]
    assert judge([weak]).cells[0].outcome == "better"
    assert judge([weak, *noise]).cells[0].outcome == "undecided"
    assert judge([weak, *noise], Rule(correction="none")).cells[0].outcome == "better"


def test_a_gate_over_many_unchanged_cells_is_silent_as_often_as_it_says() -> None:
    random = np.random.default_rng(0)
    gates, tasks = 60, 12
    alarms = {"holm": 0, "none": 0}
    for _ in range(gates):
        drawn = random.standard_normal((tasks, 2, 5)).tolist()
        for correction in alarms:
            found = judge(drawn, Rule(correction=correction), replicates=1)  # type: ignore[arg-type]
            alarms[correction] += len(found.having("undecided")) < tasks
    assert alarms["holm"] / gates <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / gates)
    assert alarms["none"] / gates > 0.3


def test_one_seed_is_not_tested_and_weighs_on_nothing() -> None:
    clear = ([90.0, 91.0, 92.0], [50.0, 51.0, 52.0])
    alone = judge([clear])
    beside = judge([clear, ([70.0], [10.0, 11.0, 12.0])])
    assert beside.cells[1].outcome == "untested"
    assert (beside.cells[1].interval, beside.cells[1].p, beside.cells[1].adjusted_p) == (None, None, None)
    assert not beside.cells[1].reachable
    assert beside.cells[0] == alone.cells[0]
    assert beside.aggregate == alone.aggregate


def test_nothing_but_single_seeds_has_no_aggregate() -> None:
    found = judge([([70.0], [10.0]), ([5.0], [6.0, 7.0])])
    assert found.aggregate is None
    assert found.having("untested") == [0, 1]


def test_without_spread_equal_is_undecided_and_different_is_decided() -> None:
    found = judge([([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]), ([2.0, 2.0], [3.0, 3.0])])
    assert [(cell.outcome, cell.p) for cell in found.cells.values()] == [("undecided", 1.0), ("worse", 0.0)]
    interval = found.cells[1].interval
    assert interval is not None
    assert (interval.low, interval.high) == (-1.0, -1.0)


def test_no_cells() -> None:
    found = judge([])
    assert (dict(found.cells), found.aggregate) == ({}, None)


@settings(max_examples=15)
@given(st.lists(st.tuples(*[st.lists(score, min_size=2, max_size=5)] * 2), min_size=1, max_size=4))
def test_aggregates_are_those_of_the_methods(pairs: list[tuple[list[float], list[float]]]) -> None:
    aggregate = judge(pairs, replicates=20).aggregate
    assert aggregate is not None
    first, second = ([pair[side] for pair in pairs] for side in (0, 1))
    assert aggregate.improvement == probability_of_improvement(first, second, replicates=20)
    expected = interquartile_mean(first, replicates=1).value - interquartile_mean(second, replicates=1).value
    assert aggregate.interquartile_mean.value == pytest.approx(expected, abs=1e-9)


def test_against_a_constant_the_difference_is_as_uncertain_as_the_subject() -> None:
    subject = [[10.0, 40.0, 25.0, 90.0], [60.0, 61.0, 80.0], [0.0, 5.0]]
    aggregate = judge([(task, [7.0, 7.0]) for task in subject], replicates=2000).aggregate
    alone = interquartile_mean(subject, replicates=2000).interval
    assert aggregate is not None and alone is not None
    interval = aggregate.interquartile_mean.interval
    assert interval is not None
    assert (interval.low, interval.high) == pytest.approx((alone.low - 7.0, alone.high - 7.0))


@pytest.mark.parametrize(
    ("test", "seeds", "tasks", "correction", "reachable"),
    [
        ("permutation", 3, 1, "none", False),
        ("permutation", 5, 1, "holm", True),
        ("permutation", 5, 10, "holm", False),
        ("permutation", 5, 10, "bh", True),
        ("mann-whitney", 3, 1, "holm", False),
        ("welch", 2, 10, "holm", True),
    ],
)
def test_what_a_design_can_reach(test: str, seeds: int, tasks: int, correction: str, reachable: bool) -> None:
    """The claim is held against the clearest scores that there are."""
    rule = Rule(test=test, correction=correction)  # type: ignore[arg-type]
    clear = ([100.0 + k for k in range(seeds)], [float(k) * 1e-3 for k in range(seeds)])
    found = judge([clear] * tasks, rule, replicates=1)
    assert {cell.reachable for cell in found.cells.values()} == {reachable}
    assert {cell.outcome == "better" for cell in found.cells.values()} == {reachable}
    smallest = best_p(found.cells[0], rule.test)
    assert smallest is not None and found.cells[0].p is not None
    assert smallest <= found.cells[0].p


def test_a_paired_test_compares_start_states() -> None:
    subject = sample_of([70.0], [60.0, 70.0, 80.0, 65.0])
    reference = sample_of([50.0], [41.0, 50.0, 59.5, 45.0])
    (cell,) = contrast({"task": (subject, reference)}, Rule(test="paired-t")).cells.values()
    assert (cell.outcome, cell.reachable) == ("better", True)
    assert best_p(cell, "wilcoxon") == 2 / 2**4


def test_a_test_that_needs_every_score_refuses_a_summary() -> None:
    published = Sample(sample_of([1.0, 2.0]).summary)
    with pytest.raises(ValueError, match="permutation"):
        contrast({"task": (sample_of([1.0, 2.0]), published)}, Rule(test="permutation"))


@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_no_level_no_verdict(alpha: float) -> None:
    with pytest.raises(ValueError, match="alpha"):
        judge([([1.0, 2.0], [3.0, 4.0])], Rule(alpha=alpha))
