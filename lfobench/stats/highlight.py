"""Highlight rule: the caption rule of the seed paper's Table 1, with its four knobs.

Sikchi, Chuck, Zhang, Niekum, "A Dual Approach to Imitation Learning from Observations with Offline
Datasets", arXiv:2406.08805v2: among the methods that see no expert actions, the best and the second best mean
are compared with a t-test. The best alone is highlighted if p < 0.05, both otherwise. With Welch's test the
rule reproduces all 24 rows of that table for 5 and for 7 seeds. Where successes are counted, Fisher's exact test of the
pooled counts takes the t-test's place, and the largest success rate that of the best mean.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Generic, Literal, TypeVar

import numpy as np

from lfobench.stats.options import Correction, HighlightTest, Scope
from lfobench.stats.tests import Sample, counted, margin, p_value, without_spread


def adjusted(p_values: Sequence[float], correction: Correction) -> list[float]:
    """Adjusted p-values ``[m]``, in the order given; rejecting those below alpha is the procedure at level alpha."""
    p = np.asarray(p_values, dtype=np.float64)
    if correction == "none" or p.size == 0:
        return [float(value) for value in p]
    order = np.argsort(p, kind="stable")
    ranks = np.arange(1, p.size + 1)
    if correction == "holm":
        stepped = np.maximum.accumulate(p[order] * (p.size - ranks + 1))
    else:
        stepped = np.minimum.accumulate((p[order] * p.size / ranks)[::-1])[::-1]
    result = np.empty_like(p)
    result[order] = np.minimum(stepped, 1.0)
    return [float(value) for value in result]


Method = TypeVar("Method", bound=Hashable)

Outcome = Literal["better", "undecided", "untested", "unopposed", "all failed"]


@dataclass(frozen=True)
class Rule:
    """The four independent choices that decide the bold face of a table.

    Attributes:
        test: between best and second best of a row; `fisher` compares success counts, every other test scores.
        scope: who competes: the methods without expert actions, or all.
        correction: for the number of rows tested.
        alpha: level below which a p-value is significant.
    """

    test: HighlightTest = "welch"
    scope: Scope = "group"
    correction: Correction = "none"
    alpha: float = 0.05


DEFAULT_RULE = Rule()


@dataclass(frozen=True)
class Highlight(Generic[Method]):
    """The outcome of one row.

    Attributes:
        methods: whose numbers are highlighted.
        outcome: `better`: the best stands out; `undecided`: the best and the second best do not differ significantly;
            `untested`: there was no test, because one of them has fewer than two samples; `unopposed`: fewer than two
            methods, so nothing is highlighted; `all failed`: successes are counted and there is none, so nothing is
            highlighted.
        best: the methods with the best mean, or success rate; two or more where they tie.
        p: two-sided p-value of best against second best; None where there was no test.
        adjusted_p: `p` corrected for the rows tested: as the rule says, by Holm where it says none.
        lost: whether one method is best, `p` alone is below alpha and `adjusted_p` is not.
        without_spread: whether `p` is a limit, for want of any spread that a t-test could estimate.
    """

    methods: frozenset[Method]
    outcome: Outcome
    best: frozenset[Method]
    p: float | None
    adjusted_p: float | None
    lost: bool
    without_spread: bool = False


@dataclass(frozen=True)
class _Row(Generic[Method]):
    """The best of a row, those that are level with them unless a correction or a test says otherwise, and its p."""

    best: frozenset[Method]
    level: frozenset[Method]
    p: float | None
    without_spread: bool


def highlights(rows: Sequence[Mapping[Method, Sample]], rule: Rule) -> list[Highlight[Method]]:
    """Highlights the rows of one table, given the samples of the methods in scope (higher is better).

    Methods that share second place are all compared with the best (p is then the largest of theirs). Methods that share
    the first are compared with each other (p is again the largest) and none of them stands out, whatever a test of
    something else than the mean says. So the outcome does not depend on the order of the columns.

    Raises:
        ValueError: the rule's test needs scores or counts that a sample lacks.
    """
    compared = [_compare(row, rule) for row in rows]
    tested = [row.p for row in compared if row is not None and row.p is not None]
    corrected = iter(adjusted(tested, rule.correction))
    by_holm = iter(adjusted(tested, "holm" if rule.correction == "none" else rule.correction))
    return [
        Highlight(frozenset(), "unopposed" if len(row) < 2 else "all failed", frozenset(row), None, None, False)
        if row_compared is None
        else Highlight(row_compared.level, "untested", row_compared.best, None, None, False)
        if row_compared.p is None
        else _decide(row_compared, row_compared.p, next(corrected), next(by_holm), rule.alpha)
        for row, row_compared in zip(rows, compared, strict=True)
    ]


def places(row: Mapping[Method, Sample], test: HighlightTest) -> list[list[Method]]:
    """The methods of a row by place, the best first; those that differ by rounding alone share one.

    By mean score, or by success rate for `fisher`.

    Raises:
        ValueError: `fisher`, and a sample without counts.
    """
    found: list[list[Method]] = []
    for method in sorted(row, key=lambda each: -_merit(row[each], test)):
        if found and margin(test, row[found[-1][0]], row[method]) == 0.0:
            found[-1].append(method)
        else:
            found.append([method])
    return found


def _merit(sample: Sample, test: HighlightTest) -> float:
    return counted(sample).pooled.rate if test == "fisher" else sample.summary.mean


def _compare(row: Mapping[Method, Sample], rule: Rule) -> _Row[Method] | None:
    """None where nothing can be best: fewer than two methods, or no success counted."""
    if len(row) < 2:
        return None
    best, *others = places(row, rule.test)
    if rule.test == "fisher" and _merit(row[best[0]], rule.test) == 0.0:
        return None
    pairs = list(combinations(best, 2)) or [(best[0], second) for second in others[0]]
    p_values = [p_value(rule.test, row[one], row[two]) for one, two in pairs]
    largest = _largest(p_values)
    level = frozenset(best)
    if len(best) == 1:
        # Several may share second place and only some of them be level with the best.
        near = [two for (_, two), p in zip(pairs, p_values, strict=True) if p is not None and p >= rule.alpha]
        level |= frozenset(near if near and largest is not None else others[0])
    return _Row(
        frozenset(best), level, largest, all(without_spread(rule.test, row[one], row[two]) for one, two in pairs)
    )


def _largest(p_values: Sequence[float | None]) -> float | None:
    """None where one is missing."""
    known = [p for p in p_values if p is not None]
    return max(known) if len(known) == len(p_values) else None


def _decide(row: _Row[Method], p: float, corrected: float, adjusted_p: float, alpha: float) -> Highlight[Method]:
    alone = len(row.best) == 1
    lost = alone and p < alpha <= adjusted_p
    if alone and corrected < alpha:
        return Highlight(row.best, "better", row.best, p, adjusted_p, lost, row.without_spread)
    return Highlight(row.level, "undecided", row.best, p, adjusted_p, lost, row.without_spread)
