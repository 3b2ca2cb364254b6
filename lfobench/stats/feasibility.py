"""Whether a design can show anything: the smallest p-value that a test can give with so many scores or episodes."""

from __future__ import annotations

from math import comb

from lfobench.stats.comparison import PAIRED, T_TESTS
from lfobench.stats.names import Correction, HighlightTest
from lfobench.stats.permutation import EXACT_RELABELLINGS, RANDOM_RELABELLINGS


def smallest_p(test: HighlightTest, n: int, m: int) -> float | None:
    """The smallest two-sided p-value of `test` with n and m scores, or episodes for Fisher's; None where there is none.

    A t-test has none above 0. A test by relabelling counts at least the outcome itself among all of them, C(n+m, n)
    over seeds and 2^n over n pairs; its mirror image too where the two sides have as many scores, as pairs do. Random
    relabellings, beyond what can be listed, cannot show less than one of them. Fisher's test is one by relabelling
    episodes: at best all of one side succeed and none of the other.
    """
    if test == "fisher":
        # Whole numbers, whose quotient may be smaller than any float, and then is 0.
        return (2 if n == m else 1) / comb(n + m, n) if min(n, m) > 0 else None
    if min(n, m) < 2:
        return None
    if test in T_TESTS:
        return 0.0
    relabellings = 2**n if test in PAIRED else comb(n + m, n)
    if relabellings <= EXACT_RELABELLINGS:
        return min(1.0, (2.0 if n == m else 1.0) / relabellings)
    # Beyond, the rank tests use the normal approximation, which has no smallest value worth a warning.
    return 1.0 / (RANDOM_RELABELLINGS + 1) if test in ("permutation", "paired-permutation") else 0.0


def can_reach(test: HighlightTest, n: int, m: int, alpha: float, comparisons: int, correction: Correction) -> bool:
    """Whether the best of `comparisons` tests with n and m scores each can come out below alpha when corrected.

    Under Holm its p-value is multiplied by their number. Under Benjamini and Hochberg it is not where all the others
    are as small, so in the best case that correction asks for nothing.
    """
    smallest = smallest_p(test, n, m)
    if smallest is None:
        return False
    return smallest * (comparisons if correction == "holm" else 1) < alpha
