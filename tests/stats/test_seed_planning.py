from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.stats.intervals import Summary, summarize
from lfobench.stats.power import (
    Design,
    can_show,
    cost,
    detectable_difference,
    detectable_effect,
    plan_tasks,
    power_for,
    seeds_needed_for,
    std_bound,
    std_interval,
)

DESIGN = Design(effect=10.0, power=0.8, alpha=0.05, test="welch", correction="holm", seeds=5)
spreads = st.integers(1, 300).map(lambda tenths: tenths / 10)
levels = st.sampled_from([0.001, 0.05, 0.2])


@pytest.mark.parametrize(
    ("n", "low", "high"), [(2, 0.4461, 31.91), (3, 0.5207, 6.285), (5, 0.5991, 2.874), (10, 0.6878, 1.826)]
)
def test_tabulated_intervals_of_a_standard_deviation(n: int, low: float, high: float) -> None:
    interval = std_interval(Summary(n, 0.0, 2.0))
    assert interval is not None
    assert (interval.low, interval.high) == pytest.approx((2.0 * low, 2.0 * high), rel=1e-3)


def test_the_bound_holds_as_often_as_it_says() -> None:
    random = np.random.default_rng(1)
    draws = 1500
    bounds = [std_bound(summarize(row)) for row in (3.0 * random.standard_normal((draws, 4))).tolist()]
    held = sum(bound is not None and bound >= 3.0 for bound in bounds) / draws
    assert held == pytest.approx(0.8, abs=4 * math.sqrt(0.16 / draws))


def test_a_single_score_has_no_spread_and_equal_ones_none() -> None:
    assert std_interval(Summary(1, 5.0, None)) is None
    assert std_bound(Summary(1, 5.0, None)) is None
    assert std_bound(Summary(3, 5.0, 0.0)) == 0.0


@settings(max_examples=15)
@given(spreads, spreads, st.integers(2, 30), st.sampled_from([0.5, 0.8, 0.95]), levels)
def test_the_detectable_difference_has_the_power_asked_for(
    first: float, second: float, n: int, power: float, alpha: float
) -> None:
    difference = detectable_difference(first, second, n, power, alpha)
    assert difference is not None
    assert power_for(difference, first, second, n, alpha) == pytest.approx(power, abs=1e-6)
    needed = seeds_needed_for(difference * 1.0001, first, second, power, alpha)
    assert needed is not None and needed <= n


@pytest.mark.parametrize("n", [2, 3, 7])
def test_with_equal_spreads_it_is_cohens_effect_in_points(n: int) -> None:
    effect = detectable_effect(n)
    assert effect is not None
    assert detectable_difference(12.0, 12.0, n, 0.8, 0.05) == pytest.approx(12.0 * effect)


def test_the_edges_of_what_is_detectable() -> None:
    assert detectable_difference(5.0, 5.0, 1, 0.8, 0.05) is None
    assert detectable_difference(0.0, 0.0, 2, 0.8, 0.05) == 0.0
    assert detectable_difference(5.0, 5.0, 3, 0.05, 0.2) == 0.0
    with pytest.raises(ValueError, match="power"):
        detectable_difference(5.0, 5.0, 3, 1.0, 0.05)


def test_the_figures_are_those_of_the_power_functions() -> None:
    pairs = [(Summary(3, 60.0, 8.0), Summary(4, 50.0, 3.0)), (Summary(3, 1.0, 2.0), Summary(3, 2.0, 2.0))]
    plan = plan_tasks(pairs, DESIGN)[0]
    assert plan.pilot is not None and plan.cautious is not None
    assert plan.pilot.seeds_alone == seeds_needed_for(10.0, 8.0, 3.0, 0.8, 0.05)
    assert plan.pilot.seeds_corrected == seeds_needed_for(10.0, 8.0, 3.0, 0.8, 0.025)
    assert plan.pilot.detectable_corrected == detectable_difference(8.0, 3.0, 5, 0.8, 0.025)
    assert plan.cautious.std_first == std_bound(pairs[0][0])
    assert plan.cautious.seeds_alone == seeds_needed_for(
        10.0, plan.cautious.std_first, plan.cautious.std_second, 0.8, 0.05
    )


@settings(max_examples=8)
@given(st.integers(2, 6), spreads, spreads, st.integers(1, 6))
def test_caution_and_correction_ask_for_more(n: int, first: float, second: float, tasks: int) -> None:
    plan = plan_tasks([(Summary(n, 0.0, first), Summary(n, 0.0, second))] * tasks, DESIGN)[0]
    assert plan.pilot is not None and plan.cautious is not None
    many = 1001  # more than are counted

    def count(seeds: int | None) -> int:
        return many if seeds is None else seeds

    assert count(plan.pilot.seeds_alone) <= count(plan.pilot.seeds_corrected)
    assert count(plan.pilot.seeds_alone) <= count(plan.cautious.seeds_alone)
    assert (plan.pilot.detectable_alone or 0.0) <= (plan.cautious.detectable_alone or 0.0)


def test_a_pilot_of_one_seed_knows_no_spread() -> None:
    (plan,) = plan_tasks([(Summary(3, 60.0, 8.0), Summary(1, 50.0, None))], DESIGN)
    assert (plan.spreads, plan.pilot, plan.cautious) == (None, None, None)


def test_without_spread_two_seeds_do_and_out_of_reach_is_said() -> None:
    flat, wild = plan_tasks(
        [(Summary(3, 1.0, 0.0), Summary(3, 1.0, 0.0)), (Summary(3, 1.0, 500.0), Summary(3, 1.0, 500.0))], DESIGN
    )
    assert flat.pilot is not None and wild.pilot is not None
    assert (flat.pilot.seeds_alone, flat.pilot.detectable_alone) == (2, 0.0)
    assert wild.pilot.seeds_alone is None


def test_the_first_step_of_a_correction() -> None:
    assert DESIGN.first_step(4) == 0.0125
    assert replace(DESIGN, correction="none").first_step(4) == 0.05


def test_what_can_come_out_significant() -> None:
    permutation = replace(DESIGN, test="permutation")
    assert can_show(permutation, 1)
    assert not can_show(permutation, 10)
    assert not can_show(replace(DESIGN, seeds=1), 1)
    assert can_show(replace(DESIGN, test="wilcoxon", seeds=1), 1, starts=10)
    assert not can_show(replace(DESIGN, test="wilcoxon", seeds=99), 1, starts=4)


def test_cost_is_the_work_over_the_workers_and_no_less_than_a_run() -> None:
    assert cost([(3, 3600.0), (1, 7200.0)], 1).hours == pytest.approx(5.0)
    assert cost([(3, 3600.0), (1, 7200.0)], 2).hours == pytest.approx(2.5)
    assert cost([(3, 3600.0), (1, 7200.0)], 100).hours == pytest.approx(2.0)


def test_cost_says_what_it_does_not_know() -> None:
    partly = cost([(3, 3600.0), (2, None)], 1)
    assert (partly.runs, partly.hours, partly.unmeasured) == (5, pytest.approx(3.0), 2)
    assert cost([(2, None)], 1).hours is None
    assert cost([(0, None), (0, 5.0)], 1).hours == 0.0
    assert cost([(0, 9000.0), (1, 3600.0)], 5).hours == pytest.approx(1.0)


@pytest.mark.parametrize("changes", [{"power": 1.0}, {"alpha": 0.0}])
def test_probabilities_are_checked(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="strictly between"):
        plan_tasks([], replace(DESIGN, **changes))
