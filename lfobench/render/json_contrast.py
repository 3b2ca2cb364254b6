"""A comparison as JSON: everything that it shows and every score behind it."""

from __future__ import annotations

import json
from typing import Any

from lfobench.render.contrast import VERDICTS, Compared, blind_because, summary
from lfobench.render.pairing import CellName
from lfobench.render.table import Cell
from lfobench.render.terminal_contrast import contrast_notes
from lfobench.stats.intervals import Estimate, Interval


def json_contrast(compared: Compared) -> str:
    """One object: the sides, the counts, every cell with the scores behind it, the aggregates, what differs."""
    pairing, rule = compared.pairing, compared.rule
    aggregate = compared.contrast.aggregate
    value = {
        "kind": pairing.kind,
        "subject": pairing.subject.name,
        "reference": pairing.reference.name,
        "summary": summary(compared),
        "regressed": compared.regressed,
        "statistic": str(compared.statistic),
        "rule": {"test": rule.test, "correction": rule.correction, "alpha": rule.alpha},
        "counts": {verdict: len(compared.having(verdict)) for verdict in VERDICTS},
        "cannot_find_anything": blind_because(compared),
        "cells": [_cell_object(compared, cell) for cell in pairing.pairs],
        "aggregate": aggregate
        and {
            "cells": [_named(cell) for cell in aggregate.cells],
            "probability_of_improvement": _estimate_object(aggregate.improvement),
            "difference_of_interquartile_means": _estimate_object(aggregate.interquartile_mean),
        },
        "only_in_subject": [_named(cell) for cell in pairing.only_subject],
        "only_in_reference": [
            {**_named(cell), "every_seed_crashed": cell in pairing.crashed} for cell in pairing.only_reference
        ],
        "differences": [
            {
                "field": each.field,
                "kind": each.kind,
                "reference": each.reference,
                "subject": each.subject,
                "cells": list(each.cells),
            }
            for each in pairing.differences
        ],
        "notes": [{"label": note.label, "text": note.text} for note in contrast_notes(compared)],
    }
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def _cell_object(compared: Compared, name: CellName) -> dict[str, Any]:
    pair, judged = compared.pairing.pairs[name], compared.contrast.cells.get(name)
    return {
        **_named(name),
        "verdict": compared.verdict(name),
        "difference": judged.difference if judged else 0.0,
        "interval": _interval_object(judged.interval) if judged else None,
        "p": judged.p if judged else None,
        "adjusted_p": judged.adjusted_p if judged else None,
        "verdict_reachable": judged.reachable if judged else None,
        "without_spread": judged.without_spread if judged else None,
        "subject": _side_object(pair.subject),
        "reference": _side_object(pair.reference),
        "identical_runs": pair.identical_runs,
        "changed_runs": pair.changed_runs,
    }


def _named(cell: CellName) -> dict[str, str]:
    task, label = cell
    return {"task": task, "column": label} if label else {"task": task}


def _side_object(cell: Cell) -> dict[str, Any]:
    assert cell.sample is not None
    counted = cell.successes.pooled if cell.successes else None
    return {
        "n": cell.sample.summary.n,
        "mean": cell.sample.summary.mean,
        "std": cell.sample.summary.std,
        "seeds": list(cell.seeds),
        "scores": list(cell.sample.seeds),
        **({"successes": counted.successes, "trials": counted.trials} if counted else {}),
        "diverged_seeds": list(cell.diverged_seeds),
        "failed_seeds": list(cell.failed_seeds),
    }


def _estimate_object(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "interval": _interval_object(estimate.interval)}


def _interval_object(interval: Interval | None) -> dict[str, float] | None:
    return {"low": interval.low, "high": interval.high, "level": interval.level} if interval else None
