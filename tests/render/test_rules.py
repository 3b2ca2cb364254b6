from __future__ import annotations

from typing import get_args

import pytest
from helpers_records import endings, make_cell, make_counted

from lfobench.errors import UserError
from lfobench.render.report.page import report
from lfobench.render.rules import make_rule, table_rule
from lfobench.stats.highlight import Rule
from lfobench.stats.names import HighlightTest, Test


def test_the_default_is_fisher_where_every_record_counts_and_else_welch() -> None:
    counting, plain = [make_counted(endings(1, 2))], make_cell([1.0, 2.0])
    assert table_rule(counting).test == "fisher"
    for records in (plain, [*counting, *plain], []):
        assert table_rule(records).test == "welch"


@pytest.mark.parametrize("test", get_args(HighlightTest))
def test_what_is_asked_for_is_taken(test: HighlightTest) -> None:
    assert table_rule([make_counted(endings(1, 2))], test, "all", "holm", 0.01) == Rule(test, "all", "holm", 0.01)


def test_the_names_are_those_of_the_scores_and_one_more() -> None:
    assert set(get_args(HighlightTest)) == {*get_args(Test), "fisher"}


def test_views_of_scores_refuse_it() -> None:
    with pytest.raises(UserError, match=r"'fisher' compares success counts.*welch, student"):
        make_rule("fisher")
    with pytest.raises(UserError, match="A report compares scores"):
        report([make_counted(endings(1, 2))], rule=Rule("fisher"))
    with pytest.raises(UserError, match="Did you mean 'fisher'"):
        table_rule([], "fischer")
