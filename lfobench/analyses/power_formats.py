"""A plan of seeds as text: a row per task, then what it costs and what it rests on; and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from lfobench.analyses.power import Budget, PilotCell, PilotTask, SeedPlan
from lfobench.stats.intervals import Interval, Summary
from lfobench.stats.power import BOUND, MOST, Figures, TaskPlan, smallest_p
from lfobench.stats.tests import FROM_SUMMARIES
from lfobench.tables.document import Document, Grid, Notes, Paragraphs, Section
from lfobench.tables.exporters.json import interval_value, json_text, notes_value
from lfobench.tables.footnote import CORRECTIONS, TESTS
from lfobench.tables.table import MISSING, Note
from lfobench.text import counted, short_number


def document(plan: SeedPlan) -> Document:
    """The plan for a terminal."""
    design = plan.design
    corrected = [f"at α = {plan.corrected_alpha:.2g}"] if _corrected(plan) else []
    columns = ["methods", "pilot std", f"at α = {design.alpha:g}", *corrected, f"shown by n = {design.seeds}"]
    rows = [_row(plan, task, figures) for task, figures in zip(plan.pilot.tasks, plan.tasks, strict=True)]
    title = f"To see {design.effect:g} points with power {design.power:g}, seeds per method:"
    return Document((Paragraphs((title,), "bold"), Grid(columns, [Section("", "", rows)]), Notes(list(notes(plan)))))


def _corrected(plan: SeedPlan) -> bool:
    return plan.corrected_alpha != plan.design.alpha


def _row(plan: SeedPlan, task: PilotTask, figures: TaskPlan) -> list[str]:
    pilot, cautious = figures.pilot, figures.cautious
    names = f"{task.first.label}, {task.second.label}"
    spreads = ", ".join(_spread(summary) for summary in (figures.first, figures.second))
    if pilot is None or cautious is None:
        return [task.task, names, spreads, *[MISSING] * (3 if _corrected(plan) else 2)]
    alone = f"{_seeds(pilot.seeds_alone)} ({_seeds(cautious.seeds_alone)})"
    corrected = f"{_seeds(pilot.seeds_corrected)} ({_seeds(cautious.seeds_corrected)})"
    shown = f"{_points(pilot.detectable_corrected)} ({_points(cautious.detectable_corrected)})"
    return [task.task, names, spreads, alone, *([corrected] if _corrected(plan) else []), shown]


def _spread(summary: Summary) -> str:
    return MISSING if summary.std is None else short_number(summary.std)


def _seeds(count: int | None) -> str:
    return f">{MOST}" if count is None else str(count)


def _points(difference: float | None) -> str:
    return "nothing" if difference is None else short_number(difference)


def notes(plan: SeedPlan) -> Iterator[Note]:
    """Everything that a reader must know to judge the figures."""
    if blind := plan.blind_because:
        yield Note("Design", f"nothing can come out significant: {blind}. Use more, or another test.")
    for budget in plan.budgets:
        yield Note("Cost", f"{budget.name}: {_cost(budget, plan.workers)}.")
    yield from _time_notes(plan)
    yield from _figure_notes(plan)
    yield from _pilot_notes(plan)
    yield from plan.pilot.notes


def _cost(budget: Budget, workers: int) -> str:
    cost = budget.cost
    text = counted(cost.runs, "more run")
    if cost.hours is not None and cost.runs:
        text += f", {_hours(cost.hours)} with {counted(workers, 'worker')}"
    if cost.unmeasured:
        text += f"; the time of {cost.unmeasured:,} of them is not known"
    if budget.without:
        text += f"; without {', '.join(budget.without)}, which no known number of seeds settles"
    return text


def _hours(hours: float) -> str:
    return "less than 0.1 h" if hours < 0.05 else f"{short_number(hours, ',.1f')} h"


def _time_notes(plan: SeedPlan) -> Iterator[Note]:
    parallel = "; on CUDA the longer of training and evaluation, shared by the seeds that trained together"
    yield Note(
        "Time",
        "mean over the pilot's runs of a cell, training and evaluation in turn"
        f"{parallel if plan.pilot.parallel else ''}; measured on {' and '.join(plan.pilot.devices)}.",
    )


def _figure_notes(plan: SeedPlan) -> Iterator[Note]:
    design, tasks = plan.design, len(plan.tasks)
    level = f"α = {design.alpha:g}"
    if _corrected(plan):
        level += (
            f", and at the first step of {CORRECTIONS[design.correction]}, {design.alpha:g} / {tasks} tasks, which the "
            "smallest p-value must pass; the last column is for that step too"
        )
    yield Note("Figures", f"for Welch's two-sided t-test of normal scores, as many seeds of both methods, at {level}.")
    if design.test not in FROM_SUMMARIES:
        n = design.seeds if plan.starts is None else plan.starts
        smallest = smallest_p(design.test, n, n)
        best = "cannot be made" if smallest is None else f"gives at best p = {smallest:.2g}"
        pairs = " It pairs start states: more seeds add no pairs." if plan.starts is not None else ""
        yield Note(
            "Test",
            f"no closed form is known for {TESTS[design.test]}, so the figures are Welch's. With {n} "
            f"{'seeds' if plan.starts is None else 'start states'} it {best}.{pairs}",
        )
    yield Note(
        "In brackets",
        f"for the upper {BOUND:.0%} confidence bound of each spread. A pilot of few seeds finds too small a spread "
        "more than half the time, and seeds planned from it then miss the effect more often than promised.",
    )


def _pilot_notes(plan: SeedPlan) -> Iterator[Note]:
    spreads = [
        f"{cell.label} on {task.task} {short_number(summary.std)} "
        f"[{short_number(interval.low)}, {short_number(interval.high)}], n = {summary.n}"
        for task, figures in zip(plan.pilot.tasks, plan.tasks, strict=True)
        if figures.spreads is not None
        for cell, summary, interval in zip(
            (task.first, task.second), (figures.first, figures.second), figures.spreads, strict=True
        )
        if summary.std is not None
    ]
    if spreads:
        yield Note("Spread", f"standard deviation with its 95% interval for normal scores: {'; '.join(spreads)}.")
    without_spread = [
        task.task for task, figures in zip(plan.pilot.tasks, plan.tasks, strict=True) if figures.spreads is None
    ]
    if without_spread:
        yield Note(
            "Unknown",
            f"a method has one seed on {', '.join(without_spread)}: no spread is known there. Run a second seed, "
            "better a third.",
        )
    if any(_spreadless(figures) for figures in plan.tasks):
        yield Note(
            "No spread", "where a pilot's scores are all equal, the formula asks for two seeds; other seeds may differ."
        )
    if plan.pilot.without:
        yield Note("Not planned", f"{', '.join(plan.pilot.without)}: fewer than two methods to compare.")
    yield Note(
        "Methods",
        "the two best means of each task in the pilot; --methods chooses others. How far apart they were plays no "
        "part.",
    )


def _spreadless(figures: TaskPlan) -> bool:
    return figures.pilot is not None and figures.pilot.std_first == figures.pilot.std_second == 0.0


def json_power(plan: SeedPlan) -> str:
    """One object: the design, a plan per task, the budgets, the notes.

    Numbers of seeds are null where more than ``most_seeds`` would be needed; figures where no spread is known.
    """
    design = plan.design
    return json_text(
        {
            "design": {
                "effect": design.effect,
                "power": design.power,
                "alpha": design.alpha,
                "corrected_alpha": plan.corrected_alpha,
                "test": design.test,
                "correction": design.correction,
                "seeds": design.seeds,
                "can_show_anything": plan.blind_because is None,
                "cannot_because": plan.blind_because,
            },
            "most_seeds": MOST,
            "cautious_confidence": BOUND,
            "tasks": [_task(task, figures) for task, figures in zip(plan.pilot.tasks, plan.tasks, strict=True)],
            "not_planned": list(plan.pilot.without),
            "workers": plan.workers,
            "budgets": [
                {
                    "name": budget.name,
                    "runs": budget.cost.runs,
                    "hours": budget.cost.hours,
                    "unmeasured_runs": budget.cost.unmeasured,
                    "without": list(budget.without),
                }
                for budget in plan.budgets
            ],
            "notes": notes_value(list(notes(plan))),
        }
    )


def _task(task: PilotTask, plan: TaskPlan) -> dict[str, Any]:
    intervals = plan.spreads or (None, None)
    return {
        "task": task.task,
        "methods": [_cell(task.first, intervals[0]), _cell(task.second, intervals[1])],
        "pilot": _figures(plan.pilot),
        "cautious": _figures(plan.cautious),
    }


def _cell(cell: PilotCell, interval: Interval | None) -> dict[str, Any]:
    summary = cell.sample.summary
    return {
        "column": cell.label,
        "n": summary.n,
        "mean": summary.mean,
        "std": summary.std,
        "std_interval": interval_value(interval),
        "seconds_per_run": cell.seconds,
    }


def _figures(figures: Figures | None) -> dict[str, Any] | None:
    if figures is None:
        return None
    return {
        "stds": [figures.std_first, figures.std_second],
        "seeds_needed": {"alone": figures.seeds_alone, "corrected": figures.seeds_corrected},
        "detectable_difference": {
            "alone": figures.detectable_alone,
            "corrected": figures.detectable_corrected,
        },
    }
