from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from self_test import false_highlight_rate

from lfobench.stats.highlight import DEFAULT_RULE, Highlight, Rule, adjusted, highlights
from lfobench.stats.intervals import Summary
from lfobench.stats.options import Correction, Test
from lfobench.stats.successes import Count, pool
from lfobench.stats.tests import PAIRED, Sample, p_value, sample_of

EVERY_TEST: tuple[Test, ...] = get_args(Test)
CORRECTIONS: tuple[Correction, ...] = get_args(Correction)

means = st.sampled_from([-5.0, 0.0, 12.5, 40.0, 97.9, 100.5]) | st.floats(-20, 130)
summaries = st.builds(
    Summary, st.integers(2, 10), means, st.sampled_from([0.0, 0.5, 8.0]) | st.floats(0.001, 40)
) | st.builds(Summary, st.just(1), means, st.none())
rows = st.dictionaries(st.sampled_from("abcdef"), summaries.map(Sample), min_size=2)
tables = st.lists(st.dictionaries(st.sampled_from("abcd"), summaries.map(Sample)), max_size=6)

# Few distinct scores: ties for best and for second best are common.
scores = st.integers(0, 3).map(float)
sampled_rows = st.dictionaries(
    st.sampled_from("abcd"),
    st.builds(sample_of, st.lists(scores, min_size=1, max_size=4), st.lists(scores, min_size=3, max_size=3)),
    min_size=2,
)


def decide(row: Mapping[str, Sample], rule: Rule = DEFAULT_RULE) -> Highlight[str]:
    (outcome,) = highlights([row], rule)
    return outcome


def mean(row: Mapping[str, Sample], method: str) -> float:
    return row[method].summary.mean


def summarized(**methods: tuple[int, float, float | None]) -> dict[str, Sample]:
    return {method: Sample(Summary(*values)) for method, values in methods.items()}


# --- one row ---------------------------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(rows)
def test_the_best_is_always_highlighted(row: dict[str, Sample]) -> None:
    best = max(sample.summary.mean for sample in row.values())
    assert {method for method in row if mean(row, method) == best} <= decide(row).methods


@settings(max_examples=40)
@given(rows)
def test_nothing_below_the_second_best_is_highlighted(row: dict[str, Sample]) -> None:
    second = sorted((sample.summary.mean for sample in row.values()), reverse=True)[1]
    assert all(mean(row, method) >= second - 1e-8 for method in decide(row).methods), "level but for rounding"


@pytest.mark.parametrize("test", EVERY_TEST)
@settings(max_examples=30)
@given(row=sampled_rows, seed=st.integers(0, 99))
def test_the_order_of_columns_does_not_matter(test: Test, row: dict[str, Sample], seed: int) -> None:
    names = random.Random(seed).sample(list(row), len(row))
    shuffled, outcome = decide({name: row[name] for name in names}, Rule(test)), decide(row, Rule(test))
    assert shuffled.methods == outcome.methods
    assert (shuffled.outcome, shuffled.best) == (outcome.outcome, outcome.best)
    assert shuffled.p == pytest.approx(outcome.p)


@settings(max_examples=40)
@given(rows, st.floats(0.001, 0.2), st.floats(0.2, 0.9))
def test_a_looser_level_never_highlights_more(row: dict[str, Sample], strict: float, loose: float) -> None:
    assert decide(row, Rule(alpha=loose)).methods <= decide(row, Rule(alpha=strict)).methods


@pytest.mark.parametrize("test", EVERY_TEST)
@settings(max_examples=30)
@given(row=sampled_rows)
def test_the_outcome_says_why(test: Test, row: dict[str, Sample]) -> None:
    outcome = decide(row, Rule(test, alpha=0.2))
    sizes = [len(row[method].starts if test in PAIRED else row[method].seeds) for method in outcome.methods]
    if outcome.outcome == "better":
        assert outcome.methods == outcome.best
        assert len(outcome.best) == 1
        assert outcome.p is not None and outcome.p < 0.2
    elif outcome.outcome == "undecided":
        assert len(outcome.methods) > 1
        assert outcome.p is not None and (outcome.p >= 0.2 or len(outcome.best) > 1)
    else:
        assert outcome.outcome == "untested"
        assert outcome.p is None and outcome.adjusted_p is None
        assert min(sizes) < 2


def test_a_clear_winner_stands_alone() -> None:
    outcome = decide(summarized(oril=(5, 60, 3), dilo=(5, 91, 0.3), smodice=(5, 85, 3)))
    assert outcome.methods == outcome.best == {"dilo"}
    assert outcome.outcome == "better"


def test_a_third_method_is_never_considered() -> None:
    row = summarized(dilo=(5, 100, 10), smodice=(5, 99, 10), oril=(5, 98, 10))
    assert decide(row).methods == {"dilo", "smodice"}


def test_without_a_second_seed_both_are_highlighted_as_untested() -> None:
    outcome = decide(summarized(dilo=(1, 100, None), smodice=(1, 3, None)))
    assert outcome.methods == {"dilo", "smodice"}
    assert outcome.outcome == "untested"


def test_a_method_alone_has_won_nothing() -> None:
    for row in ({}, summarized(dilo=(5, 100, 1))):
        outcome = decide(row)
        assert outcome == Highlight(frozenset(), "unopposed", frozenset(row), None, None, False)


def test_nobody_is_best_where_nobody_succeeded() -> None:
    failed, once = (
        sample_of([100 * count.rate], successes=pool([count], [count])) for count in (Count(0, 30), Count(1, 30))
    )
    outcome = decide({"dilo": failed, "bco": failed}, Rule("fisher"))
    assert outcome == Highlight(frozenset(), "all failed", frozenset({"dilo", "bco"}), None, None, False)
    assert decide({"dilo": failed, "bco": once}, Rule("fisher")).outcome == "undecided"


def test_all_that_tie_for_second_best_are_compared_with_the_best() -> None:
    row = summarized(dilo=(5, 100.0, 1.0), smodice=(5, 90.0, 2.0), oril=(5, 90.0, 30.0), bco=(5, 80.0, 1.0))
    outcome = decide(row)
    assert outcome.methods == {"dilo", "oril"}, "smodice is told apart from dilo, oril is not"
    assert outcome.p == p_value("welch", row["dilo"], row["oril"])
    row["oril"] = Sample(Summary(5, 90.0, 2.0))
    assert decide(row).methods == {"dilo"}
    row["oril"] = Sample(Summary(1, 90.0, None))
    assert (decide(row).methods, decide(row).outcome) == ({"dilo", "smodice", "oril"}, "untested")


@pytest.mark.parametrize("names", ["ab", "ba"])
def test_of_methods_with_one_mean_none_stands_out_whatever_a_rank_test_says(names: str) -> None:
    """Ten equal scores against eight that are a little lower and two that are much higher."""
    constant, skewed = sample_of([10.0] * 10), sample_of([9.75] * 8 + [11.0] * 2)
    p = p_value("mann-whitney", constant, skewed)
    assert p is not None and p < 0.05
    for correction in CORRECTIONS:
        outcome = decide(dict(zip(names, (constant, skewed), strict=True)), Rule("mann-whitney", correction=correction))
        assert outcome.methods == outcome.best == {"a", "b"}
        assert (outcome.outcome, outcome.p, outcome.lost) == ("undecided", p, False)


def test_the_test_is_the_one_asked_for() -> None:
    random_numbers = np.random.default_rng(1)
    row = {
        name: sample_of(random_numbers.normal(shift, 25, 6).tolist(), random_numbers.normal(shift, 25, 6).tolist())
        for name, shift in (("a", 60.0), ("b", 50.0), ("c", 0.0))
    }
    first, second = sorted(row, key=lambda name: -mean(row, name))[:2]
    found = {test: decide(row, Rule(test)).p for test in EVERY_TEST}
    assert found == {test: p_value(test, row[first], row[second]) for test in EVERY_TEST}
    assert len(set(found.values())) == len(EVERY_TEST)


def test_a_sample_that_the_test_cannot_use_is_an_error() -> None:
    with pytest.raises(ValueError, match="every score, not a summary"):
        decide(summarized(dilo=(5, 100, 1), oril=(5, 80, 1)), Rule("permutation"))


# --- many rows -------------------------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(tables)
def test_a_correction_never_names_more_winners(table: list[dict[str, Sample]]) -> None:
    raw, bh, holm = (highlights(table, Rule(correction=correction)) for correction in ("none", "bh", "holm"))
    for looser, stricter in ((raw, bh), (bh, holm)):
        for before, after in zip(looser, stricter, strict=True):
            assert after.outcome == before.outcome or (before.outcome, after.outcome) == ("better", "undecided")
            assert before.methods <= after.methods


@settings(max_examples=40)
@given(tables, st.sampled_from(CORRECTIONS), st.sampled_from([0.01, 0.05, 0.3]))
def test_what_is_lost_is_what_correcting_takes_away(
    table: list[dict[str, Sample]], correction: Correction, alpha: float
) -> None:
    outcomes = highlights(table, Rule(correction=correction, alpha=alpha))
    p = [outcome.p for outcome in outcomes if outcome.p is not None]
    # Where no correction is asked for, the dagger says what Holm's would take away.
    corrected = iter(adjusted(p, "holm" if correction == "none" else correction))
    for outcome in outcomes:
        if outcome.p is None:
            assert outcome.adjusted_p is None
            assert not outcome.lost
        else:
            assert outcome.adjusted_p == next(corrected)
            assert outcome.lost == (len(outcome.best) == 1 and outcome.p < alpha <= outcome.adjusted_p)
            decisive = outcome.p if correction == "none" else outcome.adjusted_p
            assert (outcome.outcome == "better") == (len(outcome.best) == 1 and decisive < alpha)


@settings(max_examples=40)
@given(tables)
def test_rows_are_decided_one_by_one_without_a_correction(table: list[dict[str, Sample]]) -> None:
    for row, outcome in zip(table, highlights(table, DEFAULT_RULE), strict=True):
        alone = decide(row)
        assert (outcome.methods, outcome.outcome, outcome.best, outcome.p) == (
            alone.methods,
            alone.outcome,
            alone.best,
            alone.p,
        )


def test_rows_without_a_test_do_not_count_against_the_others() -> None:
    tested = summarized(dilo=(5, 100, 5), oril=(5, 90, 5))
    single = summarized(dilo=(1, 100, None), oril=(1, 90, None))
    outcome = highlights([single, tested, {}, tested], Rule(correction="holm"))[1]
    assert outcome.p is not None
    assert outcome.adjusted_p == pytest.approx(2 * outcome.p)


def test_a_winner_that_does_not_survive_shares_its_highlight_under_the_correction() -> None:
    close, far = summarized(dilo=(5, 100, 5), oril=(5, 92, 5)), summarized(dilo=(5, 100, 5), oril=(5, 99, 5))
    raw = highlights([close, far, far], DEFAULT_RULE)[0]
    assert (raw.methods, raw.outcome, raw.lost) == ({"dilo"}, "better", True)
    corrected = highlights([close, far, far], Rule(correction="holm"))[0]
    assert (corrected.methods, corrected.outcome, corrected.lost) == ({"dilo", "oril"}, "undecided", True)


# --- the null self-test ----------------------------------------------------------------------------------------------


def single_winner(scores_of_methods: Sequence[Sequence[float]] | np.ndarray, rule: Rule) -> bool:
    row = {method: sample_of(list(values), list(values)) for method, values in enumerate(scores_of_methods)}
    return highlights([row], rule)[0].outcome == "better"


@pytest.mark.parametrize("test", EVERY_TEST)
def test_identical_methods_are_single_winners_no_more_often_than_alpha(test: Test) -> None:
    """Three methods with five scores each; for a paired test the scores are of starts that matter to nobody."""
    count, alpha = (1500 if test == "welch" else 400), 0.05
    rate = false_highlight_rate(lambda row: single_winner(row, Rule(test, alpha=alpha)), 3, 5, count).value
    assert rate <= alpha + 4 * math.sqrt(alpha * (1 - alpha) / count)


def test_no_row_of_a_table_of_identical_methods_stands_out_more_often_than_alpha_under_holm() -> None:
    """Two methods, where a row's winner is no rarer than alpha: uncorrected, most tables of 24 rows name one."""
    table_count, row_count, alpha = 100, 24, 0.05
    random_numbers = np.random.default_rng(0)
    named = {"none": 0, "holm": 0}
    for _ in range(table_count):
        drawn = random_numbers.standard_normal((row_count, 2, 5)).tolist()
        table = [{method: sample_of(values) for method, values in enumerate(row)} for row in drawn]
        outcomes = highlights(table, Rule(correction="holm", alpha=alpha))
        named["holm"] += any(outcome.outcome == "better" for outcome in outcomes)
        named["none"] += any(outcome.p is not None and outcome.p < alpha for outcome in outcomes)
    assert named["holm"] / table_count <= alpha + 4 * math.sqrt(alpha * (1 - alpha) / table_count)
    assert named["none"] / table_count > 0.3
