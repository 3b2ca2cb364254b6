"""Audits of small tables whose answers are known beforehand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import ttest_ind_from_stats

from lfobench.records.publication import (
    Claim,
    PrintedCount,
    PrintedMean,
    PublishedRow,
    ScoreScale,
    TableOfCounts,
    TableOfMeans,
)
from lfobench.stats.audit import CountsAudit, CountsRule, MeansAudit, audit_counts, audit_means
from lfobench.stats.highlight import Rule
from lfobench.stats.intervals import Summary
from lfobench.stats.power import power_for
from lfobench.stats.tests import welch_test

SUCCESS_RATE = ScoreScale({}, 0.0, 1.0)


def cell(mean: float, std: float | None, highlighted: bool | None = None, n: int | None = None) -> PrintedMean:
    return PrintedMean(mean, std, 0.01, None if std is None else 0.01, n, highlighted)


def table(*rows: dict[str, PrintedMean], n: tuple[int, ...] = (5,), scale: ScoreScale | None = None) -> TableOfMeans:
    return TableOfMeans(
        "T",
        tuple(PublishedRow({"task": f"row {index}"}, cells) for index, cells in enumerate(rows)),
        claims=tuple(Claim(each, f"place {each}") for each in n),
        scales=(scale,) if scale else (),
    )


def audit(of: TableOfMeans, rule: Rule | None = None, n: tuple[int, ...] = ()) -> MeansAudit:
    return audit_means(of, of.methods, rule or Rule(), n)


def found(of: TableOfMeans, n: tuple[int, ...] = ()) -> list[str]:
    return [contradiction.text for contradiction in audit(of, n=n).contradictions]


APART = {"a": cell(9.0, 1.0, True), "b": cell(1.0, 1.0, False)}
LEVEL = {"a": cell(9.0, 1.0, True), "b": cell(8.9, 1.0, False)}


# --- what follows ----------------------------------------------------------------------------------------------------


def test_a_highlight_follows_or_does_not() -> None:
    (at_n,) = audit(table(APART, LEVEL)).by_n
    assert [row.follows for row in at_n.rows] == [True, False]
    assert [row.outcome for row in at_n.rows] == ["better", "undecided"]
    assert at_n.rows[1].ruled == {"a", "b"}


def test_p_is_of_the_best_against_the_second_best() -> None:
    row = {"c": cell(0.0, 9.0), "a": cell(5.0, 1.0), "b": cell(4.0, 2.0)}
    (at_n,) = audit(table(row)).by_n
    assert at_n.rows[0].p == welch_test(Summary(5, 5.0, 1.0), Summary(5, 4.0, 2.0))
    assert at_n.rows[0].printed is None
    assert at_n.rows[0].follows is None


def test_corrections_count_the_rows_tested_and_no_others() -> None:
    untested = {"a": cell(9.0, None), "b": cell(1.0, None)}
    alone = {"a": cell(9.0, 1.0)}
    (at_n,) = audit(table(LEVEL, APART, untested, alone)).by_n
    assert [row.outcome for row in at_n.rows] == ["undecided", "better", "untested", "unopposed"]
    smallest = at_n.rows[1].p
    assert smallest is not None
    assert at_n.rows[1].holm == at_n.rows[1].bh == pytest.approx(2 * smallest)
    assert at_n.rows[2].holm is None
    assert len(at_n.tested) == 2


def test_what_a_correction_takes_is_lost_and_the_rule_may_contain_it() -> None:
    near = {"a": cell(2.0, 1.0, True), "b": cell(0.3, 1.0, False)}
    (plain,) = audit(table(near, LEVEL, LEVEL, LEVEL)).by_n
    assert [row.name for row in plain.lost("holm")] == ["row 0"]
    assert plain.rows[0].follows
    (corrected,) = audit(table(near, LEVEL, LEVEL, LEVEL), Rule(correction="holm")).by_n
    assert corrected.rows[0].outcome == "undecided"
    assert [row.name for row in corrected.lost("holm")] == ["row 0"]


def test_every_claim_of_n_gets_its_audit_unless_a_reader_says_one() -> None:
    of = table(APART, n=(7, 5))
    assert [at_n.n for at_n in audit(of).by_n] == [5, 7]
    assert [at_n.n for at_n in audit(of, n=(3,)).by_n] == [3]
    assert audit(table(APART, n=())).by_n == ()


def test_cells_that_state_their_n_are_taken_at_their_word() -> None:
    of = table({"a": cell(5.0, 1.0, n=3), "b": cell(4.0, 2.0, n=9)}, n=())
    (at_n,) = audit(of).by_n
    assert at_n.n is None
    assert at_n.rows[0].p == welch_test(Summary(3, 5.0, 1.0), Summary(9, 4.0, 2.0))
    assert audit(of, n=(4,)).by_n[0].rows[0].p == welch_test(Summary(4, 5.0, 1.0), Summary(4, 4.0, 2.0))


def test_the_sizes_that_give_every_highlight() -> None:
    """At some n the rule begins to tell them apart, and does so from then on."""
    of = table({"a": cell(2.0, 1.0, True), "b": cell(1.0, 1.0, False)}, n=())
    first = next(n for n in range(2, 31) if (welch_test(Summary(n, 2.0, 1.0), Summary(n, 1.0, 1.0)) or 0.0) < 0.05)
    assert audit(of).reproducing == tuple(range(first, 31))
    assert audit(table({"a": cell(2.0, 1.0), "b": cell(1.0, 1.0)})).reproducing == ()


def test_a_test_of_scores_is_refused() -> None:
    with pytest.raises(ValueError, match="needs every score"):
        audit(table(APART), Rule("permutation"))
    with pytest.raises(ValueError, match="at least two samples"):
        audit(table(APART), n=(1,))


# --- what print leaves open ------------------------------------------------------------------------------------------


def whole(mean: float, std: float, highlighted: bool | None = None) -> PrintedMean:
    return PrintedMean(mean, std, 1.0, 1.0, None, highlighted)


def test_a_printed_zero_is_an_interval() -> None:
    """50 ± 0 and 49 ± 0 of three samples: two spreads of 0.5 give p = 0.07, two of 0 give 0."""
    of = table({"a": whole(50.0, 0.0, True), "b": whole(49.0, 0.0, False)}, n=(3,))
    (row,) = audit(of).by_n[0].rows
    largest = float(ttest_ind_from_stats(50.0, 0.5, 3, 49.0, 0.5, 3, equal_var=False).pvalue)
    assert (row.p, row.decided, row.follows) == (pytest.approx(largest), False, None)
    assert row.p_range is not None and row.p_range[0] == 0.0
    assert 0.07 < largest <= row.p_range[1] < 0.075
    assert audit(of).by_n[0].winners == audit(of).by_n[0].judged == []
    effect = audit(of).effects[0]
    assert effect is not None and effect.needed is not None
    assert power_for(1.0, 0.5, 0.5, effect.needed) >= 0.8 > power_for(1.0, 0.5, 0.5, effect.needed - 1)
    decided = audit(of, n=(10,)).by_n[0].rows[0]
    assert decided.decided and decided.follows and (decided.p or 0.0) > 0.0, "0.5 is too small to matter with ten"


@settings(max_examples=60)
@given(
    st.tuples(st.integers(0, 9), st.integers(0, 9)),
    st.integers(1, 40),
    st.integers(2, 9),
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)
def test_every_spread_that_prints_alike_gives_a_p_in_the_range(
    stds: tuple[int, int], difference: int, n: int, hidden: tuple[float, float]
) -> None:
    (row,) = audit(table({"a": whole(50.0 + difference, stds[0]), "b": whole(50.0, stds[1])}, n=(n,))).by_n[0].rows
    true = [max(0.0, std + each) for std, each in zip(stds, hidden, strict=True)]
    p = welch_test(Summary(n, 50.0 + difference, true[0]), Summary(n, 50.0, true[1]))
    assert row.p_range is not None and p is not None
    low, high = row.p_range
    # Five spreads of each side are tried; between them p moves by less than this.
    assert low - 0.02 <= p <= high + 0.02
    assert row.decided == (high < 0.05 or low >= 0.05)


def test_digits_that_are_printed_decide() -> None:
    (row,) = audit(table({"a": cell(50.0, 0.0, True), "b": cell(49.0, 0.0, False)}, n=(3,))).by_n[0].rows
    assert row.decided and row.follows
    largest = float(ttest_ind_from_stats(50.0, 0.005, 3, 49.0, 0.005, 3, equal_var=False).pvalue)
    assert row.p == pytest.approx(largest)


# --- what it needed --------------------------------------------------------------------------------------------------


def test_the_samples_needed_are_the_fewest_with_that_power() -> None:
    (effect, _) = audit(table({"a": cell(3.0, 1.0), "b": cell(1.0, 2.0)}, LEVEL)).effects
    assert effect is not None and effect.needed is not None and effect.needed_by_holm is not None
    assert (effect.best, effect.second, effect.difference) == ("a", "b", 2.0)
    assert power_for(2.0, 1.0, 2.0, effect.needed) >= 0.8 > power_for(2.0, 1.0, 2.0, effect.needed - 1)
    assert power_for(2.0, 1.0, 2.0, effect.needed_by_holm, 0.025) >= 0.8
    assert power_for(2.0, 1.0, 2.0, effect.needed_by_holm - 1, 0.025) < 0.8


def test_no_number_of_samples_shows_equal_means() -> None:
    (equal, alone, spreadless) = audit(
        table(
            {"a": cell(3.0, 1.0), "b": cell(3.0, 1.0)},
            {"a": cell(3.0, 1.0)},
            {"a": cell(3.0, 1.0), "b": cell(1.0, None)},
        )
    ).effects
    assert equal is not None and equal.needed is None
    assert alone is None
    assert spreadless is None


def test_of_several_second_best_the_hardest_counts() -> None:
    (effect,) = audit(table({"a": cell(3.0, 1.0), "b": cell(1.0, 0.1), "c": cell(1.0, 4.0)})).effects
    assert effect is not None and effect.second == "c"


# --- contradictions --------------------------------------------------------------------------------------------------


def test_a_sound_table_has_none() -> None:
    assert found(table(APART, LEVEL, scale=ScoreScale({}, 0.0, 100.0))) == []


def test_two_claims_of_n() -> None:
    assert found(table(APART, n=(5, 7))) == ["n is 5 by place 5 and 7 by place 7"]


@pytest.mark.parametrize(
    ("row", "text"),
    [
        (
            {"a": cell(9.0, 1.0, True), "b": cell(5.0, 1.0, False), "c": cell(1.0, 1.0, True)},
            "c is highlighted and is neither best nor second best",
        ),
        (
            {"a": cell(9.0, 1.0, False), "b": cell(5.0, 1.0, True)},
            "b is highlighted and the best, a, is not",
        ),
        (
            {"a": cell(9.0, 1.0, True), "b": cell(9.0, 1.0, False)},
            "a is highlighted and b, with the same numbers, is not",
        ),
        ({"a": cell(9.0, 1.0, True)}, "a is highlighted without a competitor"),
        (
            {"a": cell(9.0, 1.0, None, 1), "b": cell(8.0, 1.0, None, 2)},
            "a has a spread, 1, and one sample, which has none",
        ),
    ],
)
def test_each_kind_is_found(row: dict[str, PrintedMean], text: str) -> None:
    assert found(table(row)) == [text]


def test_a_spread_beyond_the_scores_is_found() -> None:
    # Half of four scores 0, half 1: the largest spread that a mean of 0.5 allows is √(4/3) / 2 = 0.577.
    assert found(table({"a": cell(0.5, 0.57)}, n=(4,), scale=SUCCESS_RATE)) == []
    (text,) = found(table({"a": cell(0.5, 0.60)}, n=(4,), scale=SUCCESS_RATE))
    assert "at most 0.577" in text
    assert len(found(table({"a": cell(1.2, 0.1)}, n=(4,), scale=SUCCESS_RATE))) == 1


def test_a_mean_off_the_grid_is_found_with_the_sizes_that_fit() -> None:
    scale = ScoreScale({}, 0.0, 100.0, step=25.0, episodes=10)
    assert found(table({"a": cell(43.0, 5.3)}, n=(5,), scale=scale)) == []
    (text,) = found(table({"a": cell(43.0, 5.3)}, n=(7,), scale=scale))
    assert text.endswith("a 43 (fits n = 5, 10)")
    # A score without a spread is a reference, not a mean of samples.
    assert found(table({"expert": cell(43.0, None)}, n=(7,), scale=scale)) == []


def test_a_scale_speaks_of_its_rows_only() -> None:
    scale = ScoreScale({"task": "another"}, 0.0, 1.0, 0.5, 1)
    assert found(table(APART, scale=scale)) == []


@given(
    st.integers(2, 8),
    st.integers(1, 20),
    st.integers(0, 3),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=60)
def test_numbers_of_real_samples_are_never_accused(n: int, episodes: int, decimals: int, cut: bool, seed: int) -> None:
    """Whatever the samples, printed by rounding or by cutting off digits."""
    scores = np.random.default_rng(seed).integers(0, 5, size=(n, episodes)).mean(axis=1) * 25.0
    unit = 10.0**-decimals

    def printed(value: float) -> float:
        return math.floor(value / unit + 1e-9) * unit if cut else round(value, decimals)

    one = PrintedMean(printed(scores.mean()), printed(scores.std(ddof=1)), unit, unit, None, None)
    of = table({"a": one}, n=(n,), scale=ScoreScale({}, 0.0, 100.0, 25.0, episodes))
    assert found(of) == []


# --- successes -------------------------------------------------------------------------------------------------------


def counts(*rows: dict[str, tuple[int, int, bool | None]], rule: CountsRule | None = None) -> CountsAudit:
    of = TableOfCounts(
        "T",
        tuple(
            PublishedRow({"task": str(index)}, {method: PrintedCount(*values) for method, values in row.items()})
            for index, row in enumerate(rows)
        ),
    )
    return audit_counts(of, of.methods, rule or CountsRule())


def test_the_largest_count_is_not_yet_better() -> None:
    found = counts(
        {"a": (8, 10, True), "b": (6, 10, False)},
        {"a": (10, 10, True), "b": (0, 10, False)},
        {"a": (5, 10, True), "b": (5, 10, True)},
        {"a": (5, 10, True)},
    )
    assert [row.outcome for row in found.rows] == ["undecided", "better", "undecided", "unopposed"]
    assert [row.merely_largest for row in found.rows] == [True, False, True, False]
    assert found.rows[2].p == pytest.approx(1.0)
    assert found.closest is found.rows[1]
    assert [each.text for each in found.contradictions] == ["a is highlighted without a competitor"]


def test_boschloo_and_a_correction_change_the_verdict() -> None:
    row: dict[str, tuple[int, int, bool | None]] = {"a": (9, 10, True), "b": (4, 10, False)}
    level: dict[str, tuple[int, int, bool | None]] = {"a": (5, 10, True), "b": (5, 10, True)}
    assert counts(row).rows[0].outcome == "undecided"
    assert counts(row, rule=CountsRule("boschloo")).rows[0].outcome == "better"
    assert counts(row, level, level, rule=CountsRule("boschloo", "holm")).rows[0].outcome == "undecided"


def test_equal_rates_of_unequal_trials_are_level() -> None:
    found = counts({"a": (5, 10, True), "b": (10, 20, False)})
    assert found.rows[0].best == {"a", "b"}
    assert [each.text for each in found.contradictions] == ["a is highlighted and b, with the same numbers, is not"]
