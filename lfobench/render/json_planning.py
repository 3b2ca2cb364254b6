"""A plan of seeds as JSON: the figures unrounded, with what they were made from."""

from __future__ import annotations

import json
from typing import Any

from lfobench.render.pilot import PilotCell, PilotTask
from lfobench.render.planning import SeedPlan
from lfobench.render.terminal_planning import planning_notes
from lfobench.stats.intervals import Interval
from lfobench.stats.planning import BOUND, MOST, Figures, TaskPlan


def json_planning(plan: SeedPlan) -> str:
    """One object: the design, a plan per task, the budgets, the notes.

    Numbers of seeds are null where more than ``most_seeds`` would be needed; figures where no spread is known.
    """
    design = plan.design
    value = {
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
        "notes": [{"label": note.label, "text": note.text} for note in planning_notes(plan)],
    }
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


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
        "std_interval": {"low": interval.low, "high": interval.high, "level": interval.level} if interval else None,
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
