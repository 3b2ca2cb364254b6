"""Whether two means agree within a margin: two one-sided Welch tests.

References:
    D. J. Schuirmann, "A comparison of the two one-sided tests procedure and the power approach for assessing the
    equivalence of average bioavailability", Journal of Pharmacokinetics and Biopharmaceutics 15, 1987.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from lfobench.stats.intervals import Interval, around, check_probability, satterthwaite, welch_interval
from lfobench.stats.names import Agreement
from lfobench.stats.summary import Summary, difference


@dataclass(frozen=True)
class EquivalenceResult:
    """Whether two means agree within a margin.

    Attributes:
        difference: first mean minus second.
        interval: of the difference at level 1 - 2α, which lies inside the margin exactly when p < α; None when a
            side has fewer than two samples.
        p: the larger p-value of the two one-sided tests, or None as above. Small means equivalent.
        agreement: `matches`: the difference is shown to be smaller than the margin; `differs`: the means are shown
            to differ, and not to match; `undecided`: neither is shown.
    """

    difference: float
    interval: Interval | None
    p: float | None
    agreement: Agreement


def equivalence_test(first: Summary, second: Summary, margin: float, alpha: float = 0.05) -> EquivalenceResult:
    """Tests that two means differ by less than `margin`, in the samples' unit; variances may differ.

    A difference that is significant and yet shown to be smaller than the margin `matches`: the margin says which
    differences are worth a word. Without any spread on both sides the limit of a shrinking spread decides: p is 0
    inside the margin, 1 outside, 1/2 on it.

    Raises:
        ValueError: the margin is not positive and finite, or α is not between 0 and 1/2.
    """
    check_probability("2 alpha", 2.0 * alpha)
    if not 0.0 < margin < math.inf:
        raise ValueError(f"A margin is positive and finite; got {margin}.")
    apart = difference(first, second)
    interval = welch_interval(first, second, 1.0 - alpha)
    if first.std is None or second.std is None or interval is None:
        return EquivalenceResult(apart, None, None, "undecided")
    standard_error, degrees = satterthwaite(first.std, first.n, second.std, second.n)
    p = _larger_p(margin - abs(apart), standard_error, degrees)
    agreement: Agreement = "undecided"
    if p < alpha:
        agreement = "matches"
    elif not interval.low <= 0.0 <= interval.high:
        agreement = "differs"
    return EquivalenceResult(apart, around(apart, standard_error, degrees, 1.0 - 2.0 * alpha), p, agreement)


def _larger_p(room: float, standard_error: float, degrees: float) -> float:
    """The p-value of the one-sided test whose bound is nearer, `room` away from the difference."""
    if standard_error == 0.0:
        return 0.5 if room == 0.0 else float(room < 0.0)
    from scipy.stats import t

    return float(t.sf(room / standard_error, degrees))
