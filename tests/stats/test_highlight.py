from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lfobench.stats.correction import adjusted
from lfobench.stats.highlight import Highlight, Rule, highlights
from lfobench.stats.names import Correction
from lfobench.stats.null import false_highlight_rate
from lfobench.stats.sample import Sample, sample_of
from lfobench.stats.summary import Summary

means = st.sampled_from([-5.0, 0.0, 12.5, 40.0, 97.9, 100.5]) | st.floats(-20, 130)
summaries = st.builds(
    Summary, st.integers(2, 10), means, st.sampled_from([0.0, 0.5, 8.0]) | st.floats(0.001, 40)
) | st.builds(Summary, st.just(1), means, st.none())


def highlight(row: dict[str, Summary], alpha: float) -> Highlight[str]:
    """The outcome of a table of one row."""
    (outcome,) = highlights([{name: Sample(summary) for name, summary in row.items()}], Rule(alpha=alpha))
    return outcome


rows = st.dictionaries(st.sampled_from("abcdef"), summaries, min_size=2)


@given(rows)
def test_the_best_is_always_highlighted(row: dict[str, Summary]) -> None:
    best = max(summary.mean for summary in row.values())
    assert {method for method, summary in row.items() if summary.mean == best} <= highlight(row, 0.05).methods


@given(rows)
def test_nothing_below_the_second_best_is_highlighted(row: dict[str, Summary]) -> None:
    second = sorted((summary.mean for summary in row.values()), reverse=True)[1]
    assert all(row[method].mean >= second for method in highlight(row, 0.05).methods)


@given(rows, st.randoms(use_true_random=False))
def test_the_order_of_columns_does_not_matter(row: dict[str, Summary], random: object) -> None:
    names = list(row)
    random.shuffle(names)  # type: ignore[attr-defined]
    shuffled = highlight({name: row[name] for name in names}, 0.05)
    assert shuffled.methods == highlight(row, 0.05).methods
    assert shuffled.outcome == highlight(row, 0.05).outcome


@given(rows, st.floats(0.001, 0.2), st.floats(0.2, 0.9))
def test_a_looser_level_never_highlights_more(row: dict[str, Summary], strict: float, loose: float) -> None:
    assert highlight(row, loose).methods <= highlight(row, strict).methods


@given(rows)
def test_the_verdict_says_why(row: dict[str, Summary]) -> None:
    outcome = highlight(row, 0.05)
    if outcome.outcome == "better":
        assert len(outcome.methods) == 1
        assert outcome.p is not None and outcome.p < 0.05
    elif outcome.outcome == "undecided":
        assert len(outcome.methods) > 1
        assert outcome.p is not None and outcome.p >= 0.05
    else:
        assert outcome.outcome == "untested"
        assert outcome.p is None
        assert any(row[method].n < 2 for method in outcome.methods)


def test_a_clear_winner_stands_alone() -> None:
    outcome = highlight({"oril": Summary(5, 60, 3), "dilo": Summary(5, 91, 0.3), "smodice": Summary(5, 85, 3)}, 0.05)
    assert outcome.methods == {"dilo"}
    assert outcome.outcome == "better"


def test_a_third_method_is_never_considered() -> None:
    row = {"dilo": Summary(5, 100, 10), "smodice": Summary(5, 99, 10), "oril": Summary(5, 98, 10)}
    assert highlight(row, 0.05).methods == {"dilo", "smodice"}


def test_without_a_second_seed_both_are_highlighted_as_undecided() -> None:
    outcome = highlight({"dilo": Summary(1, 100, None), "smodice": Summary(1, 3, None)}, 0.05)
    assert outcome.methods == {"dilo", "smodice"}
    assert outcome.outcome == "untested"


def test_a_method_alone_has_won_nothing() -> None:
    for row in ({}, {"dilo": Summary(5, 100, 1)}):
        outcome = highlight(row, 0.05)
        assert outcome.methods == frozenset()
        assert outcome.outcome == "unopposed"


many = st.lists(rows, min_size=1, max_size=6)


@given(many, st.sampled_from(["holm", "bh"]))
def test_a_correction_never_adds_a_winner_and_daggers_say_which_it_takes(
    table: list[dict[str, Summary]], correction: Correction
) -> None:
    samples = [{name: Sample(summary) for name, summary in row.items()} for row in table]
    plain, corrected = highlights(samples, Rule()), highlights(samples, Rule(correction=correction))
    tested = [outcome.p for outcome in plain if outcome.p is not None]
    by_holm, by_it = iter(adjusted(tested, "holm")), iter(adjusted(tested, correction))
    for before, after in zip(plain, corrected, strict=True):
        assert after.p == before.p
        assert before.methods <= after.methods
        assert not (after.outcome == "better" and before.outcome != "better")
        if before.p is not None:
            assert before.adjusted_p == next(by_holm)
            assert before.lost == (before.p < 0.05 <= before.adjusted_p)
            assert after.adjusted_p == next(by_it)
            assert (after.outcome == "better") == (after.adjusted_p < 0.05)


def test_identical_methods_are_highlighted_no_more_often_than_alpha() -> None:
    """Best against second best of 3 equal methods is conservative: about 1.7% at a level of 5%."""

    def alone(scores: NDArray[np.float64]) -> bool:
        (outcome,) = highlights([dict(enumerate(map(sample_of, scores.tolist())))], Rule())
        return outcome.outcome == "better"

    rate = false_highlight_rate(alone, methods=3, seeds=5, rows=1500)
    assert rate.interval is not None
    assert rate.interval.low <= 0.05
    assert rate.value <= 0.05 + 4 * (0.05 * 0.95 / 1500) ** 0.5


def test_holm_keeps_whole_tables_of_identical_methods_at_alpha() -> None:
    generator = np.random.default_rng(1)
    tables, wrong = 150, 0
    for _ in range(tables):
        scores = generator.normal(size=(24, 2, 5)).tolist()
        found = highlights([dict(enumerate(map(sample_of, row))) for row in scores], Rule(correction="holm"))
        wrong += any(outcome.outcome == "better" for outcome in found)
    assert wrong / tables <= 0.05 + 4 * (0.05 * 0.95 / tables) ** 0.5


def test_a_tie_for_the_best_is_a_tie() -> None:
    outcome = highlight({"dilo": Summary(5, 90, 1), "oril": Summary(5, 90, 2), "bco": Summary(5, 10, 1)}, 0.05)
    assert outcome.methods == outcome.best == {"dilo", "oril"}
    assert outcome.outcome == "undecided"


def test_a_test_that_needs_every_score_says_so() -> None:
    with pytest.raises(ValueError, match="'permutation' needs every score"):
        highlights([{"dilo": Sample(Summary(5, 1, 1)), "oril": Sample(Summary(5, 2, 1))}], Rule(test="permutation"))
