"""Logging into a job's progress: evaluations, rows of metrics, and which seeds diverged."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from lfobench.engine.checkpoint import Progress
from lfobench.engine.evaluation import EpisodeResults
from lfobench.record import Evaluation, Metrics

if TYPE_CHECKING:
    from torch import Tensor


def log_evaluation(progress: Progress, step: int, results: EpisodeResults) -> None:
    """Append an evaluation to every seed that has not diverged by `step`.

    A seed that answered with something that is not finite has.
    """
    for index, rows in enumerate(progress.evaluations):
        diverged_at = progress.diverged_at[index]
        if diverged_at is not None and diverged_at <= step:
            continue
        if not results.finite[index]:
            progress.diverged_at[index] = step
            continue
        rows.append(_evaluation(step, results, index))


def log_final_evaluation(progress: Progress, step: int, results: EpisodeResults) -> list[Evaluation | None]:
    """The evaluation of the trained policies, per seed; None for one that diverged, here or before."""
    for index, finite in enumerate(results.finite):
        if not finite and progress.diverged_at[index] is None:
            progress.diverged_at[index] = step
    return [
        _evaluation(step, results, index) if diverged_at is None else None
        for index, diverged_at in enumerate(progress.diverged_at)
    ]


def log_metrics(progress: Progress, stage: str, sums: Mapping[str, Tensor], count: int) -> None:
    """Append a row of means to every seed.

    Args:
        progress: where to.
        stage: its name.
        sums: per name, the sum of the last `count` updates' values ``[S]``.
        count: of updates.
    """
    means = {name: (total.double() / count).tolist() for name, total in sums.items()}
    for index, rows in enumerate(progress.metrics):
        values = {name: _finite(per_seed[index]) for name, per_seed in means.items()}
        rows.append(Metrics(stage=stage, step=progress.step, values=values))


def mark_diverged(progress: Progress, finite: Tensor) -> None:
    """A seed whose state or latest metrics are not finite is diverged; the others go on.

    Args:
        progress: where it is marked.
        finite: ``[S]``; whether the method's state is.
    """
    for index, seed_is_finite in enumerate(finite.tolist()):
        rows = progress.metrics[index]
        metrics_are_finite = not rows or None not in rows[-1].values.values()
        if progress.diverged_at[index] is None and not (seed_is_finite and metrics_are_finite):
            progress.diverged_at[index] = progress.step


def _evaluation(step: int, results: EpisodeResults, seed: int) -> Evaluation:
    return Evaluation(
        step=step,
        returns=results.returns[seed].tolist(),
        lengths=results.lengths[seed].tolist(),
        outcomes=None if results.outcomes is None else results.outcomes[seed],
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
