"""The knobs of a view: what is taken where nothing is asked for, and what is refused."""

from __future__ import annotations

from typing import get_args

import pytest
from helpers_records import endings, make_cell, make_counted

from lfobench.errors import UserError
from lfobench.score import HEADLINE, SUCCESS_RATE, Statistic
from lfobench.stats.highlight import Rule
from lfobench.stats.options import HighlightTest, Test
from lfobench.tables.counting import knobs

COUNTING = [make_counted(endings(1, 2))]


def test_success_and_fisher_where_every_record_counts_and_else_last5_and_welch() -> None:
    plain = make_cell([1.0, 2.0])
    assert knobs(COUNTING) == (SUCCESS_RATE, Rule("fisher"))
    for records in (plain, [*COUNTING, *plain], []):
        assert knobs(records) == (HEADLINE, Rule("welch"))


def test_what_is_asked_for_decides_the_other() -> None:
    assert knobs(COUNTING, test="welch") == (SUCCESS_RATE, Rule("welch")), "the seeds' success rates"
    assert knobs(COUNTING, statistic="last5") == (HEADLINE, Rule("welch"))
    assert knobs(COUNTING, "at:9", "student") == (Statistic("at", 9), Rule("student"))
    assert knobs([], test="fisher") == (SUCCESS_RATE, Rule("fisher"))
    assert knobs([], statistic="success") == (SUCCESS_RATE, Rule("fisher"))


@pytest.mark.parametrize("test", get_args(HighlightTest))
def test_what_is_asked_for_is_taken(test: HighlightTest) -> None:
    assert knobs(COUNTING, None, test, "all", "holm", 0.01)[1] == Rule(test, "all", "holm", 0.01)


def test_the_names_are_those_of_the_scores_and_one_more() -> None:
    assert set(get_args(HighlightTest)) == {*get_args(Test), "fisher"}


def test_unknown_names_and_levels_are_refused() -> None:
    with pytest.raises(UserError, match="Did you mean 'fisher'"):
        knobs([], test="fischer")
    with pytest.raises(UserError, match="Unknown statistic 'mean'"):
        knobs([], statistic="mean")
    with pytest.raises(UserError, match=r"alpha = 1\.5"):
        knobs([], alpha=1.5)
