from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.stats.successes import Count, Successes, pool, variance_inflation

counts = st.integers(1, 60).flatmap(lambda trials: st.builds(Count, st.integers(0, trials), st.just(trials)))
seeds = st.lists(st.tuples(counts, counts), min_size=1, max_size=8)


@given(seeds)
def test_pooling_is_plain_counting(parts: list[tuple[Count, Count]]) -> None:
    fixed, further = zip(*parts, strict=True)
    found = pool(fixed, [one + other for one, other in parts])
    assert found.fixed == Count(sum(each.successes for each in fixed), sum(each.trials for each in fixed))
    assert found.pooled.successes == sum(each.successes for each in (*fixed, *further))
    assert found.pooled.trials == sum(each.trials for each in (*fixed, *further))
    assert found.seeds == tuple(one + other for one, other in parts)


@given(counts)
def test_the_interval_contains_the_rate(count: Count) -> None:
    interval = Successes(count, count).interval
    assert 0.0 <= interval.low <= count.rate <= interval.high <= 1.0


def test_what_is_no_count_is_refused() -> None:
    for successes, trials in ((0, 0), (3, 2), (-1, 2)):
        with pytest.raises(ValueError, match="at least one trial"):
            Count(successes, trials)
    with pytest.raises(ValueError, match="at least one"):
        pool([], [])
    with pytest.raises(ValueError, match="the same seeds twice"):
        pool([Count(1, 2)], [Count(1, 2), Count(1, 2)])


# --- variance inflation ----------------------------------------------------------------------------------------------

# Weil's rat pups (1970), survivors out of each litter: table 1 of Rao and Scott (1992).
CONTROL = "13/13 12/12 9/9 9/9 8/8 8/8 12/13 11/12 9/10 9/10 8/9 11/13 4/5 5/7 7/10 7/10"
TREATED = "12/12 11/11 10/10 9/9 10/11 9/10 9/10 8/9 8/9 4/5 7/9 4/7 5/10 3/6 3/10 0/7"


def clusters(text: str) -> list[Count]:
    return [Count(*map(int, each.split("/"))) for each in text.split()]


@pytest.mark.parametrize(("litters", "expected"), [(CONTROL, 1.232495), (TREATED, 3.952861)])
def test_the_example_of_the_paper(litters: str, expected: float) -> None:
    assert variance_inflation(clusters(litters)) == pytest.approx(expected, abs=1e-6)


@given(st.integers(2, 40), st.data())
def test_with_as_many_trials_each_it_is_the_sample_variance_over_the_binomial_one(
    trials: int, data: st.DataObject
) -> None:
    found = data.draw(st.lists(st.integers(0, trials), min_size=2, max_size=8))
    inflation = variance_inflation([Count(successes, trials) for successes in found])
    rates = np.array(found) / trials
    p = rates.mean()
    if 0 < sum(found) < trials * len(found):
        assert inflation == pytest.approx(trials * rates.var(ddof=1) / (p * (1 - p)), rel=1e-9, abs=1e-12)
    else:
        assert inflation is None


def test_seeds_alike_show_none_and_seeds_of_all_or_nothing_show_all_of_it() -> None:
    assert variance_inflation([Count(5, 10)] * 4) == 0.0
    # Every episode repeats its seed: 10 trials are worth one, m / (m - 1) apart.
    assert variance_inflation([Count(10, 10), Count(0, 10)] * 3) == pytest.approx(10 * 6 / 5)


@pytest.mark.parametrize("known", [[Count(3, 10)], [], [Count(0, 10)] * 3, [Count(10, 10), Count(4, 4)]])
def test_where_nothing_varies_nothing_is_known(known: Sequence[Count]) -> None:
    assert variance_inflation(known) is None
    assert Successes(Count(1, 2), Count(1, 2), tuple(known)).inflation is None


@settings(max_examples=40)
@given(st.lists(counts, min_size=2, max_size=8), st.randoms(use_true_random=False))
def test_the_order_of_seeds_does_not_matter(known: list[Count], random: object) -> None:
    inflation = variance_inflation(known)
    shuffled = list(known)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert variance_inflation(shuffled) == (None if inflation is None else pytest.approx(inflation, abs=1e-12))


def test_independent_episodes_show_about_one() -> None:
    """Seven seeds of 110 episodes: about chi-square with 6 degrees of freedom over 6."""
    cells, m = 400, 7
    drawn = np.random.default_rng(0).binomial(110, 0.7, size=(cells, m))
    found = [variance_inflation([Count(int(each), 110) for each in cell]) for cell in drawn]
    assert np.mean([each for each in found if each is not None]) == pytest.approx(
        1.0, abs=4 * math.sqrt(2 / (m - 1) / cells)
    )
