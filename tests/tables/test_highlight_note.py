"""What the footnote says of the highlights: the four knobs, what was not tested, and what could not have been shown."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import get_args

import pytest

from lfobench.record import Record
from lfobench.stats.highlight import Rule
from lfobench.stats.options import Correction, HighlightTest, Scope, Test
from lfobench.stats.tests import PAIRED
from lfobench.tables.building import build_table
from lfobench.tables.footnote import CORRECTIONS, SCOPES, TESTS


def notes(records: Iterable[Record], rule: Rule) -> dict[str, str]:
    return {note.label: note.text for note in build_table(list(records), rule=rule).notes}


def two_methods(make_cell: Callable[..., list[Record]], seeds: int, rows: int = 1) -> list[Record]:
    return [
        record
        for row in range(rows)
        for method, mean in (("dilo", 100.0), ("oril", 60.0))
        for record in make_cell([mean + seed for seed in range(seeds)], method, row=f"row{row}")
    ]


def test_every_knob_has_words() -> None:
    assert set(TESTS) == set(get_args(HighlightTest))
    assert set(CORRECTIONS) == set(get_args(Correction))
    assert set(SCOPES) == set(get_args(Scope))


def test_all_four_knobs_are_in_the_note(make_cell: Callable[..., list[Record]]) -> None:
    rule = Rule(test="student", scope="all", correction="holm", alpha=0.01)
    assert notes(two_methods(make_cell, 5, rows=3), rule)["Highlighted"] == (
        "the best mean in its row among all methods, and the second best too unless Student's two-sided t-test between "
        "them gives p < 0.01 corrected by Holm over the 3 rows tested. Correction for multiple comparisons: Holm."
    )
    plain = notes(two_methods(make_cell, 5, rows=3), Rule())["Highlighted"]
    assert plain == (
        "the best mean in its row among the methods without expert actions, and the second best too unless Welch's "
        "two-sided t-test between them gives p < 0.05. Correction for multiple comparisons: none."
    )


@pytest.mark.parametrize("test", get_args(Test))
def test_paired_tests_say_what_they_speak_of(test: Test, make_cell: Callable[..., list[Record]]) -> None:
    found = notes(two_methods(make_cell, 5), Rule(test))
    assert TESTS[test] in found["Highlighted"]
    assert ("Pairs" in found) == (test in PAIRED)
    if test in PAIRED:
        assert "not to other training seeds" in found["Pairs"]


def test_rows_without_a_test_are_named(make_cell: Callable[..., list[Record]]) -> None:
    records = [
        *two_methods(make_cell, 3, rows=1),
        *make_cell([1.0], row="ant"),
        *make_cell([2.0, 3.0], "oril", row="ant"),
        *make_cell([2.0, 3.0], row="walker2d"),
    ]
    text = notes(records, Rule(correction="holm"))["Highlighted"]
    assert "Not tested for want of a second seed, both highlighted: ant-random-expert." in text
    assert text.endswith("Nothing to compare, nothing highlighted: walker2d-random-expert.")
    assert "over the 1 rows tested" in text


def test_one_seed_is_enough_for_pairs_and_nothing_else_is_said(make_cell: Callable[..., list[Record]]) -> None:
    for test in get_args(Test):
        text = notes(two_methods(make_cell, 1), Rule(test))
        assert ("cannot be tested" in text["Seeds"]) == (test not in PAIRED)
        assert ("for want of a second seed" in text["Highlighted"]) == (test not in PAIRED)
        assert "one seed has no standard deviation" in text["Seeds"]


def test_one_start_is_not_enough_for_pairs(make_cell: Callable[..., list[Record]]) -> None:
    records = [
        record.model_copy(
            update={
                "evaluations": [
                    evaluation.model_copy(update={"returns": evaluation.returns[:1], "lengths": [1]})
                    for evaluation in record.evaluations
                ]
            }
        )
        for record in two_methods(make_cell, 3)
    ]
    text = notes(records, Rule("wilcoxon"))
    assert "a second start state, both highlighted: every row" in text["Highlighted"]
    assert "Design" not in text


# --- the dagger ------------------------------------------------------------------------------------------------------


def close_rows(make_cell: Callable[..., list[Record]]) -> list[Record]:
    """Four rows: one that p < 0.05 alone decides, three that nothing does."""
    records = make_cell([96.0, 100.0, 104.0]) + make_cell([84.0, 90.0, 94.0], "oril")
    for row in ("ant", "walker2d", "halfcheetah"):
        records += make_cell([96.0, 100.0, 104.0], row=row) + make_cell([95.0, 99.0, 104.0], "oril", row=row)
    return records


@pytest.mark.parametrize(("correction", "by"), [("none", "Holm"), ("holm", "Holm"), ("bh", "Benjamini-Hochberg")])
def test_the_dagger_is_explained(correction: Correction, by: str, make_cell: Callable[..., list[Record]]) -> None:
    text = notes(close_rows(make_cell), Rule(correction=correction))
    assert text["†"] == f"stands out with p < 0.05, and no longer when corrected by {by} over 4 rows."


def test_no_dagger_no_explanation(make_cell: Callable[..., list[Record]]) -> None:
    assert "†" not in notes(two_methods(make_cell, 5, rows=3), Rule())
    assert "†" not in notes(close_rows(make_cell), Rule(alpha=1e-6))


# --- designs that can show nothing -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("test", "seeds", "rows", "correction", "said"),
    [
        ("mann-whitney", 3, 1, "none", "with 3 seeds, the two-sided Mann-Whitney test gives at best p = 0.1, so no"),
        ("mann-whitney", 4, 1, "none", None),
        ("permutation", 4, 2, "holm", "p = 0.029, times 2 under Holm, so no row could have come out significant."),
        ("permutation", 4, 2, "bh", None),
        ("welch", 2, 24, "holm", None),
        ("paired-permutation", 2, 1, "none", "with 2 start states, the two-sided sign-flip test"),
        ("permutation", 1, 1, "none", None),
    ],
)
def test_a_design_that_can_show_nothing_is_said(
    test: Test,
    seeds: int,
    rows: int,
    correction: Correction,
    said: str | None,
    make_cell: Callable[..., list[Record]],
) -> None:
    """Every record of this file has two episodes an evaluation."""
    text = notes(two_methods(make_cell, seeds, rows), Rule(test, correction=correction))
    if said is None:
        assert "Design" not in text
    else:
        assert said in text["Design"]
        assert text["Design"].endswith("Use more, or another test.")


def test_seeds_of_methods_that_do_not_compete_hide_nothing(make_cell: Callable[..., list[Record]]) -> None:
    many = make_cell([float(seed) for seed in range(9)], "bc", sees_expert_actions=True, row="row0")
    more = make_cell([float(seed) for seed in range(9)], "bc-expert", sees_expert_actions=True, row="row0")
    records = [*two_methods(make_cell, 3), *many, *more]
    assert "Design" in notes(records, Rule("permutation"))
    assert "Design" not in notes(records, Rule("permutation", scope="all"))


def test_one_row_that_can_show_something_is_enough(make_cell: Callable[..., list[Record]]) -> None:
    records = [
        *two_methods(make_cell, 3, rows=2),
        *make_cell([5.0] * 7, row="ant"),
        *make_cell([4.0] * 7, "oril", row="ant"),
    ]
    assert "Design" not in notes(records, Rule("permutation"))
    unequal = [
        *two_methods(make_cell, 3, rows=2),
        *make_cell([5.0] * 7, row="ant"),
        *make_cell([4.0], "oril", row="ant"),
    ]
    assert "with 3 seeds" in notes(unequal, Rule("permutation"))["Design"], "ant was not tested"
