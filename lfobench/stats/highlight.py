"""Which numbers of a row are highlighted: the caption rule of the seed paper's Table 1.

Sikchi, Chuck, Zhang, Niekum, "A Dual Approach to Imitation Learning from Observations with Offline
Datasets", arXiv:2406.08805v2: among the methods that see no expert actions, the best and the second best mean
are compared with a t-test. The best alone is highlighted if p < 0.05, both otherwise. With Welch's test the
rule reproduces all 24 rows of that table for 5 and for 7 seeds.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

from lfobench.stats.comparison import welch_test
from lfobench.stats.summary import Summary

Method = TypeVar("Method", bound=Hashable)

Verdict = Literal["better", "indistinguishable", "undecided", "unopposed"]


@dataclass(frozen=True)
class Highlight(Generic[Method]):
    """The outcome of one row.

    Attributes:
        methods: whose numbers are highlighted.
        verdict: `better`: the best mean stands out; `indistinguishable`: the test cannot tell the best from
            the second best; `undecided`: there was no test, because one of them has fewer than two samples;
            `unopposed`: fewer than two methods, so nobody won anything and nothing is highlighted.
        p: two-sided p-value of best against second best; None where there was no test.
    """

    methods: frozenset[Method]
    verdict: Verdict
    p: float | None


def highlight(row: Mapping[Method, Summary], alpha: float) -> Highlight[Method]:
    """Highlights one row, given the summaries of the methods in scope (higher is better).

    Methods that tie exactly for second best share that place and are all compared with the best (p is then
    the largest of theirs), so the outcome does not depend on the order of the columns.
    """
    if len(row) < 2:
        return Highlight(frozenset(), "unopposed", None)
    best = max(row, key=lambda method: row[method].mean)
    others = {method: summary for method, summary in row.items() if method != best}
    second_mean = max(summary.mean for summary in others.values())
    p_values = {
        method: welch_test(row[best], summary) for method, summary in others.items() if summary.mean == second_mean
    }
    tested = [p for p in p_values.values() if p is not None]
    level = {method for method, p in p_values.items() if p is None or p >= alpha}
    verdict: Verdict = "indistinguishable" if level else "better"
    if len(tested) < len(p_values):
        verdict = "undecided"
    return Highlight(frozenset({best, *level}), verdict, max(tested) if verdict != "undecided" else None)
