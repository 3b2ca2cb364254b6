"""Highlights by success counts: the rule of the means, with rates for means and Fisher's test for the t-test."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import fisher_exact

from lfobench.stats.contrast import contrast
from lfobench.stats.highlight import Highlight, Rule, highlights
from lfobench.stats.successes import Count, Successes, newcombe_interval
from lfobench.stats.tests import Sample, sample_of

# Few distinct rates: ties for best and for second best are common.
counts = st.sampled_from([5, 10, 20]).flatmap(lambda trials: st.builds(Count, st.integers(0, trials), st.just(trials)))
rows = st.dictionaries(st.sampled_from("abcd"), counts, min_size=2)


def sampled(count: Count) -> Sample:
    """A score that says the opposite, so that only the count can decide."""
    return sample_of([100.0 * (1.0 - count.rate)], successes=Successes(count, count, (count,)))


def decide(row: dict[str, Count], rule: Rule) -> Highlight[str]:
    (outcome,) = highlights([{method: sampled(count) for method, count in row.items()}], rule)
    return outcome


def by_scipy(one: Count, two: Count) -> float:
    table = [[one.successes, two.successes], [one.trials - one.successes, two.trials - two.successes]]
    return float(fisher_exact(table).pvalue)


@settings(max_examples=80)
@given(rows, st.sampled_from([0.01, 0.05, 0.3]))
def test_the_highlight_agrees_with_a_direct_call(row: dict[str, Count], alpha: float) -> None:
    outcome = decide(row, Rule("fisher", alpha=alpha))
    rates = sorted({count.rate for count in row.values()}, reverse=True)
    best = {method for method, count in row.items() if count.rate == rates[0]}
    assert outcome.best == best
    if rates[0] == 0.0:
        assert (outcome.outcome, outcome.methods) == ("all failed", set())
        return
    if len(best) > 1:
        assert (outcome.outcome, outcome.methods) == ("undecided", best)
        return
    (winner,) = best
    against = {method: by_scipy(row[winner], count) for method, count in row.items() if count.rate == rates[1]}
    assert outcome.p == pytest.approx(max(against.values()))
    if max(against.values()) < alpha:
        assert (outcome.outcome, outcome.methods) == ("better", best)
    else:
        assert outcome.outcome == "undecided"
        assert outcome.methods == best | {method for method, p in against.items() if p >= alpha}


@settings(max_examples=40)
@given(rows, st.integers(0, 99))
def test_the_order_of_columns_does_not_matter(row: dict[str, Count], seed: int) -> None:
    names = random.Random(seed).sample(list(row), len(row))
    one, other = decide(row, Rule("fisher")), decide({name: row[name] for name in names}, Rule("fisher"))
    assert (one.methods, one.outcome, one.best) == (other.methods, other.outcome, other.best)


def test_one_seed_is_enough_and_scores_are_not() -> None:
    row = {"dilo": Count(9, 10), "bco": Count(1, 10)}
    assert decide(row, Rule("fisher")).methods == {"dilo"}
    with pytest.raises(ValueError, match="how every episode ended"):
        highlights([{name: sample_of([1.0, 2.0]) for name in row}], Rule("fisher"))


def test_corrections_and_levels_apply() -> None:
    close = {"dilo": Count(9, 10), "bco": Count(3, 10)}
    p = by_scipy(close["dilo"], close["bco"])
    assert 0.01 < p < 0.05 < 3 * p
    table = [{method: sampled(count) for method, count in close.items()}] * 3
    raw, holm = (highlights(table, Rule("fisher", correction=name))[0] for name in ("none", "holm"))  # type: ignore[arg-type]
    assert (raw.outcome, raw.lost, holm.outcome, holm.lost) == ("better", True, "undecided", True)
    assert holm.adjusted_p == pytest.approx(3 * p)
    assert decide(close, Rule("fisher", alpha=0.01)).outcome == "undecided"


def test_a_contrast_by_counts_says_what_the_counts_say_and_not_the_scores() -> None:
    many, few = Count(36, 40), Count(12, 40)
    found = contrast({"task": (sampled(many), sampled(few)), "same": (sampled(few), sampled(few))}, Rule("fisher"))
    apart, same = found.cells["task"], found.cells["same"]
    assert (apart.outcome, apart.p, apart.difference) == ("better", by_scipy(many, few), pytest.approx(60.0))
    assert apart.interval is not None and apart.interval.low < 60.0 < apart.interval.high
    assert (same.outcome, same.difference) == ("undecided", 0.0)
    assert same.p == pytest.approx(1.0)
    swapped = contrast({"task": (sampled(few), sampled(many))}, Rule("fisher")).cells["task"]
    assert (swapped.outcome, swapped.difference) == ("worse", pytest.approx(-60.0))
    assert not contrast({"task": (sampled(Count(1, 2)), sampled(Count(0, 2)))}, Rule("fisher")).cells["task"].reachable


def test_newcombes_interval_is_the_published_one() -> None:
    """Newcombe 1998, table II: 56/70 against 48/80, method 10."""
    found = newcombe_interval(56, 70, 48, 80)
    assert (found.low, found.high) == pytest.approx((0.0524, 0.3339), abs=5e-5)
    whole = newcombe_interval(10, 10, 0, 10)
    assert (whole.low, whole.high) == pytest.approx((0.6075, 1.0), abs=5e-5)
