"""A pilot out of records, the plan that follows from it, and how it is drawn."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from helpers_folders import with_provenance
from helpers_records import make_cell, make_record
from rich.console import Console

from lfobench.analyses.power import SeedPlan, read_pilot, run_seconds, seeds_needed
from lfobench.analyses.power_formats import document, json_power
from lfobench.errors import UserError
from lfobench.record import Record
from lfobench.score import HEADLINE
from lfobench.stats.power import Design

DESIGN = Design(effect=10.0, power=0.8, alpha=0.05, test="welch", correction="holm", seeds=5)


def timed(records: Sequence[Record], train: float, **provenance: Any) -> list[Record]:
    return [with_provenance(record, seconds={"train": train, "evaluate": 100.0}, **provenance) for record in records]


def two_tasks() -> list[Record]:
    return [
        *timed(make_cell([60.0, 70.0, 65.0]), 3500.0),
        *timed(make_cell([50.0, 52.0, 51.0], "smodice"), 1700.0),
        *make_cell([40.0, 20.0], row="ant"),
        *make_cell([10.0, 12.0], "smodice", row="ant"),
        *make_cell([99.0, 99.5, 98.0], "bc", sees_expert_actions=True),
    ]


def planned(records: Sequence[Record], design: Design = DESIGN, workers: int = 1, **options: Any) -> SeedPlan:
    return seeds_needed(read_pilot(records, HEADLINE, **options), design, workers)


def draw(plan: SeedPlan, width: int = 120) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(document(plan))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def notes(plan: SeedPlan, label: str) -> list[str]:
    return [each["text"] for each in json.loads(json_power(plan))["notes"] if each["label"] == label]


# --- the pilot -------------------------------------------------------------------------------------------------------


def test_the_best_two_of_every_task_in_scope() -> None:
    pilot = read_pilot(two_tasks(), HEADLINE)
    assert [(task.task, task.first.label, task.second.label) for task in pilot.tasks] == [
        ("hopper-random-expert", "dilo", "smodice"),
        ("ant-random-expert", "dilo", "smodice"),
    ]
    assert read_pilot(two_tasks(), HEADLINE, "all").tasks[0].first.label == "bc"


def test_a_task_with_one_method_is_named() -> None:
    pilot = read_pilot([*two_tasks(), *make_cell([1.0, 2.0], row="walker2d")], HEADLINE)
    assert pilot.without == ("walker2d-random-expert",)


def test_no_task_with_two_methods() -> None:
    with pytest.raises(UserError, match="--scope all"):
        read_pilot([*make_cell([1.0]), *make_cell([2.0], "bc", sees_expert_actions=True)], HEADLINE)


def test_a_method_that_is_not_timed_on_a_task_costs_as_on_the_others() -> None:
    hopper, ant = read_pilot(two_tasks(), HEADLINE).tasks
    assert (hopper.first.seconds, hopper.second.seconds) == (3600.0, 1800.0)
    assert (ant.first.seconds, ant.second.seconds) == (3600.0, 1800.0)
    assert read_pilot([*make_cell([1.0]), *make_cell([2.0], "bco")], HEADLINE).tasks[0].first.seconds is None


@pytest.mark.parametrize(
    ("provenance", "seconds"),
    [
        ({"seconds": {"train": 100, "evaluate": 20, "load": 5}, "device": {"type": "cpu"}}, 125.0),
        ({"seconds": {"train": 100, "evaluate": 20}}, 120.0),
        ({"seconds": {"train": 100, "evaluate": 20, "load": 5}, "device": {"type": "cuda"}}, 105.0),
        ({"seconds": {"train": 100, "evaluate": 180}, "device": {"type": "cuda"}, "seeds_trained_together": 6}, 30.0),
        ({}, None),
        ({"seconds": "long"}, None),
        ({"seconds": {"train": float("nan")}}, None),
        ({"seconds": {"train": 10, "evaluate": "x"}, "device": 3, "seeds_trained_together": 0}, 10.0),
    ],
)
def test_the_seconds_of_a_run(provenance: dict[str, Any], seconds: float | None) -> None:
    """In turn on a CPU; beside training, and shared by the seeds of a job, on CUDA; provenance is anybody's text."""
    assert run_seconds(with_provenance(make_record(1.0), **provenance)) == seconds


# --- the plan --------------------------------------------------------------------------------------------------------


def test_what_is_missing_is_what_it_costs() -> None:
    plan = planned(two_tasks())
    everywhere = plan.budgets[0]
    # 2 and 3 runs of each method are missing.
    assert everywhere.cost.runs == 10
    assert everywhere.cost.hours == pytest.approx(5 * 1.0 + 5 * 0.5)
    assert planned(two_tasks(), workers=4).budgets[0].cost.hours == pytest.approx(7.5 / 4)
    needed = [figures.pilot.seeds_corrected for figures in plan.tasks if figures.pilot]
    assert plan.budgets[1].cost.runs == sum(
        max(0, count - n) * 2 for count, n in zip(needed, (3, 2), strict=True) if count is not None
    )


def test_nothing_is_missing() -> None:
    plan = planned(two_tasks(), replace(DESIGN, seeds=2))
    assert (plan.budgets[0].cost.runs, plan.budgets[0].cost.hours) == (0, 0.0)
    assert "0 more runs." in notes(plan, "Cost")[0]


def test_a_pilot_of_one_seed_says_that_no_spread_is_known() -> None:
    plan = planned([*two_tasks(), *make_cell([5.0], row="walker2d"), *make_cell([6.0], "smodice", row="walker2d")])
    assert "no spread is known" in notes(plan, "Unknown")[0]
    assert plan.budgets[1].without == ("walker2d-random-expert",)
    assert "walker2d-random-expert" in draw(plan)


def test_scores_without_spread_are_named() -> None:
    plan = planned([*make_cell([5.0, 5.0]), *make_cell([6.0, 6.0], "bco")])
    assert notes(plan, "No spread")
    assert "2 (2)" in draw(plan)


def test_times_that_nobody_measured() -> None:
    plan = planned([*make_cell([5.0, 9.0]), *make_cell([6.0, 1.0], "bco")])
    assert plan.budgets[0].cost.hours is None
    assert "the time of 6 of them is not known" in notes(plan, "Cost")[0]


def test_a_test_that_cannot_show_anything() -> None:
    plan = planned(two_tasks(), replace(DESIGN, test="permutation", seeds=3))
    assert plan.blind_because is not None and "p = 0.1" in plan.blind_because
    assert "nothing can come out significant" in notes(plan, "Design")[0]
    assert "Welch's" in notes(plan, "Test")[0]
    assert planned(two_tasks(), replace(DESIGN, test="permutation", seeds=9)).blind_because is None
    assert planned(two_tasks(), replace(DESIGN, seeds=1)).blind_because is not None


def test_a_paired_test_gains_nothing_from_seeds() -> None:
    plan = planned(two_tasks(), replace(DESIGN, test="wilcoxon", seeds=50))
    assert plan.starts == 2
    assert plan.blind_because is not None
    assert "more seeds add no pairs" in notes(plan, "Test")[0]


def test_the_correction_asks_for_a_column_of_its_own() -> None:
    assert "at α = 0.025" in draw(planned(two_tasks()))
    assert "0.025" not in draw(planned(two_tasks(), replace(DESIGN, correction="none")))


@pytest.mark.parametrize("changes", [{"effect": 0.0}, {"effect": float("inf")}, {"power": 1.0}, {"alpha": 0.0}])
def test_designs_that_are_none(changes: dict[str, float]) -> None:
    with pytest.raises(UserError, match=f"--{next(iter(changes))}"):
        planned(two_tasks(), replace(DESIGN, **changes))


@pytest.mark.parametrize("width", [60, 80, 140])
def test_it_fits_the_terminal(width: int) -> None:
    text = draw(planned(two_tasks()), width)
    assert all(len(line) <= width for line in text.splitlines())
    assert "hopper-random-expert" in text


def test_json_holds_the_figures() -> None:
    plan = planned(two_tasks())
    value = json.loads(json_power(plan))
    hopper = value["tasks"][0]
    assert [method["column"] for method in hopper["methods"]] == ["dilo", "smodice"]
    assert hopper["methods"][0]["seconds_per_run"] == 3600.0
    assert hopper["methods"][0]["std_interval"]["low"] < 5.0 < hopper["methods"][0]["std_interval"]["high"]
    assert plan.tasks[0].pilot is not None
    assert hopper["pilot"]["seeds_needed"]["corrected"] == plan.tasks[0].pilot.seeds_corrected
    assert hopper["cautious"]["seeds_needed"]["corrected"] > hopper["pilot"]["seeds_needed"]["corrected"]
    assert value["budgets"][0]["runs"] == 10
