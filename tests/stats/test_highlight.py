from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lfobench.stats.highlight import highlight
from lfobench.stats.summary import Summary

means = st.sampled_from([-5.0, 0.0, 12.5, 40.0, 97.9, 100.5]) | st.floats(-20, 130)
summaries = st.builds(
    Summary, st.integers(2, 10), means, st.sampled_from([0.0, 0.5, 8.0]) | st.floats(0.001, 40)
) | st.builds(Summary, st.just(1), means, st.none())
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
    assert shuffled.verdict == highlight(row, 0.05).verdict


@given(rows, st.floats(0.001, 0.2), st.floats(0.2, 0.9))
def test_a_looser_level_never_highlights_more(row: dict[str, Summary], strict: float, loose: float) -> None:
    assert highlight(row, loose).methods <= highlight(row, strict).methods


@given(rows)
def test_the_verdict_says_why(row: dict[str, Summary]) -> None:
    outcome = highlight(row, 0.05)
    if outcome.verdict == "better":
        assert len(outcome.methods) == 1
        assert outcome.p is not None and outcome.p < 0.05
    elif outcome.verdict == "indistinguishable":
        assert len(outcome.methods) > 1
        assert outcome.p is not None and outcome.p >= 0.05
    else:
        assert outcome.verdict == "undecided"
        assert outcome.p is None
        assert any(row[method].n < 2 for method in outcome.methods)


def test_a_clear_winner_stands_alone() -> None:
    outcome = highlight({"oril": Summary(5, 60, 3), "dilo": Summary(5, 91, 0.3), "smodice": Summary(5, 85, 3)}, 0.05)
    assert outcome.methods == {"dilo"}
    assert outcome.verdict == "better"


def test_a_third_method_is_never_considered() -> None:
    row = {"dilo": Summary(5, 100, 10), "smodice": Summary(5, 99, 10), "oril": Summary(5, 98, 10)}
    assert highlight(row, 0.05).methods == {"dilo", "smodice"}


def test_without_a_second_seed_both_are_highlighted_as_undecided() -> None:
    outcome = highlight({"dilo": Summary(1, 100, None), "smodice": Summary(1, 3, None)}, 0.05)
    assert outcome.methods == {"dilo", "smodice"}
    assert outcome.verdict == "undecided"


def test_a_method_alone_has_won_nothing() -> None:
    for row in ({}, {"dilo": Summary(5, 100, 1)}):
        outcome = highlight(row, 0.05)
        assert outcome.methods == frozenset()
        assert outcome.verdict == "unopposed"
