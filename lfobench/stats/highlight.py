"""Which numbers of a table are highlighted: the caption rule of the seed paper's Table 1, with its four knobs.

Sikchi, Chuck, Zhang, Niekum, "A Dual Approach to Imitation Learning from Observations with Offline
Datasets", arXiv:2406.08805v2: among the methods that see no expert actions, the best and the second best mean
are compared with a t-test. The best alone is highlighted if p < 0.05, both otherwise. With Welch's test the
rule reproduces all 24 rows of that table for 5 and for 7 seeds.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

from lfobench.stats.comparison import p_value
from lfobench.stats.correction import adjusted
from lfobench.stats.names import Correction, Scope, Test
from lfobench.stats.sample import Sample

Method = TypeVar("Method", bound=Hashable)

Outcome = Literal["better", "undecided", "untested", "unopposed"]


@dataclass(frozen=True)
class Rule:
    """The four independent choices that decide the bold face of a table.

    Attributes:
        test: between best and second best of a row.
        scope: who competes: the methods without expert actions, or all.
        correction: for the number of rows tested.
        alpha: level below which a p-value tells two methods apart.
    """

    test: Test = "welch"
    scope: Scope = "group"
    correction: Correction = "none"
    alpha: float = 0.05


DEFAULT_RULE = Rule()


@dataclass(frozen=True)
class Highlight(Generic[Method]):
    """The outcome of one row.

    Attributes:
        methods: whose numbers are highlighted.
        outcome: `better`: the best mean stands out; `undecided`: the test cannot tell the best from the second
            best; `untested`: there was no test, because one of them has fewer than two samples; `unopposed`: fewer
            than two methods, so nobody won anything and nothing is highlighted.
        best: the methods with the best mean; two or more where they tie.
        p: two-sided p-value of best against second best; None where there was no test.
        adjusted_p: `p` corrected for the rows tested: as the rule says, by Holm where it says none.
        lost: whether `p` alone is below alpha and `adjusted_p` is not.
    """

    methods: frozenset[Method]
    outcome: Outcome
    best: frozenset[Method]
    p: float | None
    adjusted_p: float | None
    lost: bool


@dataclass(frozen=True)
class _Row(Generic[Method]):
    """Best against second best: `p` per method that shares second place."""

    best: Method
    level_with_best: frozenset[Method]
    p: Mapping[Method, float | None]

    @property
    def largest(self) -> float | None:
        """The p-value of the row; None where one that it needs is missing."""
        values = [p for p in self.p.values() if p is not None]
        return max(values) if values and len(values) == len(self.p) else None


def highlights(rows: Sequence[Mapping[Method, Sample]], rule: Rule) -> list[Highlight[Method]]:
    """Highlights the rows of one table, given the samples of the methods in scope (higher is better).

    Methods that tie exactly for second best share that place and are all compared with the best (p is then
    the largest of theirs), so the outcome does not depend on the order of the columns.

    Raises:
        ValueError: the rule's test needs scores that a sample lacks.
    """
    compared = [_compare(row, rule.test) for row in rows]
    tested = [p for row in compared if row is not None and (p := row.largest) is not None]
    corrected = iter(adjusted(tested, rule.correction))
    by_holm = iter(adjusted(tested, "holm" if rule.correction == "none" else rule.correction))
    return [
        Highlight(frozenset(), "unopposed", frozenset(row), None, None, False)
        if row_compared is None
        else _untested(row_compared)
        if row_compared.largest is None
        else _decide(row_compared, row_compared.largest, next(corrected), next(by_holm), rule)
        for row, row_compared in zip(rows, compared, strict=True)
    ]


def _compare(row: Mapping[Method, Sample], test: Test) -> _Row[Method] | None:
    if len(row) < 2:
        return None
    means = {method: sample.summary.mean for method, sample in row.items()}
    best = max(row, key=lambda method: means[method])
    second = max(mean for method, mean in means.items() if method != best)
    p = {
        method: p_value(test, row[best], sample)
        for method, sample in row.items()
        if method != best and means[method] == second
    }
    return _Row(best, frozenset(method for method, mean in means.items() if mean == means[best]), p)


def _untested(row: _Row[Method]) -> Highlight[Method]:
    return Highlight(frozenset({row.best, *row.p}), "untested", row.level_with_best, None, None, False)


def _decide(row: _Row[Method], p: float, corrected: float, adjusted_p: float, rule: Rule) -> Highlight[Method]:
    lost = p < rule.alpha <= adjusted_p
    if corrected < rule.alpha:
        return Highlight(frozenset({row.best}), "better", row.level_with_best, p, adjusted_p, lost)
    # Several may share second place and only some of them be level with the best.
    level = {method for method, value in row.p.items() if value is not None and value >= rule.alpha} or set(row.p)
    return Highlight(frozenset({row.best, *level}), "undecided", row.level_with_best, p, adjusted_p, lost)
